//! Hints for MPI-IO.

use mpi::ffi;
use std::ffi::CStr;

/// The user's own hints: a file that ROMIO reads.
const OF_THE_USER: &str = "ROMIO_HINTS";

/// Each rank writes contiguous pieces, so that collecting them on one rank and reading what is
/// between them cost more than they save: frames on two ranks took 1.2 times as long.
const HINTS: [(&CStr, &CStr); 2] = [
    (c"romio_cb_write", c"disable"),
    (c"romio_ds_write", c"disable"),
];

/// An object of hints, while MPI is up.
pub(crate) struct Hints(ffi::MPI_Info);

impl Hints {
    /// `None` if the user has hints.
    pub fn new() -> Option<Self> {
        if std::env::var_os(OF_THE_USER).is_some() {
            return None;
        }
        // SAFETY: MPI is up, the out pointer is valid, and names and values are C strings that MPI
        // copies.
        unsafe {
            let mut info = ffi::RSMPI_INFO_NULL;
            let made = ffi::MPI_Info_create(&raw mut info);
            assert_eq!(made, ffi::MPI_SUCCESS as i32, "an object of hints");
            for (name, value) in HINTS {
                ffi::MPI_Info_set(info, name.as_ptr(), value.as_ptr());
            }
            Some(Self(info))
        }
    }

    /// For a library; valid as long as `self`.
    pub(crate) fn as_raw(&self) -> ffi::MPI_Info {
        self.0
    }
}

impl Drop for Hints {
    fn drop(&mut self) {
        // SAFETY: the object was made by MPI and is freed once; MPI ends after its owner is
        // dropped.
        unsafe {
            ffi::MPI_Info_free(&raw mut self.0);
        }
    }
}
