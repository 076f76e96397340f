//! Failures of MPI's file operations. HDF5 returns them when its call ends, but a rank whose
//! operation has failed may skip a part of a collective call in which the others wait for it, and
//! then itself wait for them in the next part. MPI tells that input or output failed; why, only the
//! system's number of the last error says.

use std::ffi::{c_char, c_int, c_void};
use std::io;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

use gshear_mpi_exchange::LoneFailure;
use hdf5_sys::{h5f, h5p};
use mpi::ffi;
use rustix::io::Errno;

use crate::disk;

/// Bytes of the write by which the system is asked again.
const ASKED_FOR: usize = 64 << 10;

/// A file whose failures are noted.
struct Noted {
    /// Address of MPI's file.
    handle: usize,
    path: PathBuf,
    failure: LoneFailure,
    /// Why an operation failed, if the system has told.
    reason: Option<String>,
}

/// Few: one for each path.
static FILES: Mutex<Vec<Noted>> = Mutex::new(Vec::new());

fn files() -> MutexGuard<'static, Vec<Noted>> {
    FILES.lock().unwrap_or_else(PoisonError::into_inner)
}

/// From now on, notes failures of this rank's operations on a file that was opened with MPI.
pub(super) fn note(file: &hdf5::File, path: &Path, failure: LoneFailure) -> hdf5::Result<()> {
    hdf5::sync::sync(|| {
        let mut handle: *mut c_void = std::ptr::null_mut();
        // SAFETY: the file is open; HDF5 writes the address of its MPI file into `handle`.
        let status =
            unsafe { h5f::H5Fget_vfd_handle(file.id(), h5p::H5P_DEFAULT, &raw mut handle) };
        hdf5::h5check(status)?;
        // SAFETY: HDF5's driver for MPI gives a pointer to the handle, which lives as long as the
        // file is open.
        let handle = unsafe { *handle.cast::<ffi::MPI_File>() };
        let mut files = files();
        files.retain(|file| file.handle != handle as usize && file.path != path);
        files.push(Noted {
            handle: handle as usize,
            path: path.into(),
            failure,
            reason: None,
        });
        drop(files);
        // SAFETY: MPI runs, and the file is open. The handler reads only the two arguments that
        // every call passes. MPI keeps the handler until the file is closed.
        unsafe {
            let mut handler = std::mem::zeroed();
            ffi::MPI_File_create_errhandler(Some(variadic(failed)), &raw mut handler);
            ffi::MPI_File_set_errhandler(handle, handler);
            ffi::MPI_Errhandler_free(&raw mut handler);
        }
        Ok(())
    })
}

type Handler = unsafe extern "C" fn(*mut ffi::MPI_File, *mut c_int);
type VariadicHandler = unsafe extern "C" fn(*mut ffi::MPI_File, *mut c_int, ...);

/// MPI passes further arguments that it does not specify.
fn variadic(handler: Handler) -> VariadicHandler {
    // SAFETY: in the C calling conventions of Linux, the first two arguments are passed in the same
    // registers whether or not others may follow.
    unsafe { std::mem::transmute(handler) }
}

/// Called by MPI in the operation that failed, which then returns the error.
unsafe extern "C" fn failed(file: *mut ffi::MPI_File, code: *mut c_int) {
    let last = io::Error::last_os_error();
    // SAFETY: MPI passes valid addresses.
    let (handle, code) = unsafe { (*file as usize, *code) };
    let mut text = [0u8; ffi::MPI_MAX_ERROR_STRING as usize];
    let mut length = 0;
    // SAFETY: `text` holds the longest text.
    unsafe { ffi::MPI_Error_string(code, text.as_mut_ptr().cast::<c_char>(), &raw mut length) };
    let text = String::from_utf8_lossy(&text[..length.clamp(0, text.len() as c_int) as usize]);
    if let Some(file) = files().iter_mut().find(|file| file.handle == handle) {
        if file.reason.is_none() {
            file.reason = told_by(&last).or_else(|| asked_again(&file.path));
        }
        let path = file.path.display();
        let why = match &file.reason {
            Some(reason) => reason.clone(),
            None => format!("{text}; MPI does not say whether space or quota ran out"),
        };
        (file.failure).note_cause(&format!("{path}: cannot be written: {why}"));
    }
}

/// Why this rank's operations on a file failed, if the system has told.
pub(super) fn reason(path: &Path) -> Option<String> {
    let files = files();
    let file = files.iter().find(|file| file.path == path)?;
    file.reason.clone().or_else(|| asked_again(path))
}

/// What the system says of a write beside the file, which fails for the same reason where the disk
/// is full or a quota is used up.
fn asked_again(path: &Path) -> Option<String> {
    let written =
        disk::beside(path).and_then(|file| file.as_file().write_all_at(&vec![0; ASKED_FOR], 0));
    told_by(&written.err()?)
}

/// The message of an error of the system, if it can only be that of a file that is written: the
/// last one may be older than a failure, or younger.
fn told_by(error: &io::Error) -> Option<String> {
    let of_files = [
        Errno::NOSPC,
        Errno::DQUOT,
        Errno::FBIG,
        Errno::ROFS,
        Errno::STALE,
    ];
    let of_files = of_files.map(|errno| Some(errno.raw_os_error()));
    of_files.contains(&error.raw_os_error()).then(|| {
        let number = error.raw_os_error().unwrap_or_default();
        io::Error::from_raw_os_error(number).to_string()
    })
}
