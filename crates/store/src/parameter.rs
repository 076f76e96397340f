//! The attributes of a file that describe its run.

use std::collections::BTreeMap;
use std::fmt;

use hdf5::Location;
use hdf5::types::{FixedAscii, FixedUnicode, TypeDescriptor, VarLenAscii, VarLenUnicode};

/// Longest fixed-length string attribute that is read; HDF5 itself allows no more than 64 KiB in an
/// attribute.
const TEXT: usize = 65_536;
/// Such strings of one attribute; no file has as many.
const MOST_TEXTS: usize = 64;

/// An attribute of `parameters`.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
#[serde(untagged)]
pub enum Parameter {
    /// Text.
    Text(String),
    /// Integer.
    Integer(i64),
    /// Number.
    Number(f64),
    /// List of numbers.
    Numbers(Vec<f64>),
}

/// All attributes of a group, by name.
pub type Parameters = BTreeMap<String, Parameter>;

impl fmt::Display for Parameter {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Parameter::Text(text) => f.write_str(text),
            Parameter::Integer(value) => write!(f, "{value}"),
            Parameter::Number(value) => write!(f, "{value:?}"),
            Parameter::Numbers(values) => write!(f, "{values:?}"),
        }
    }
}

/// All attributes of a group, by name. An error comes with the attribute that it is about.
pub(crate) fn attributes(group: &Location) -> Result<Parameters, (String, hdf5::Error)> {
    let names = group.attr_names().map_err(|e| (String::new(), e))?;
    let mut parameters = Parameters::new();
    for name in names {
        match parameter(group, &name) {
            Ok(value) => parameters.insert(name, value),
            Err(e) => return Err((format!(": attribute {name}"), e)),
        };
    }
    Ok(parameters)
}

fn parameter(group: &Location, name: &str) -> hdf5::Result<Parameter> {
    let attribute = group.attr(name)?;
    Ok(match attribute.dtype()?.to_descriptor()? {
        TypeDescriptor::VarLenUnicode => {
            Parameter::Text(lossy(attribute.read_scalar::<VarLenUnicode>()?.as_bytes()))
        }
        TypeDescriptor::VarLenAscii => {
            Parameter::Text(lossy(attribute.read_scalar::<VarLenAscii>()?.as_bytes()))
        }
        TypeDescriptor::FixedUnicode(_) | TypeDescriptor::FixedAscii(_)
            if attribute.size() > MOST_TEXTS =>
        {
            return Err("holds too many texts".into());
        }
        TypeDescriptor::FixedUnicode(_) => {
            let texts = attribute.read_raw::<FixedUnicode<TEXT>>()?;
            Parameter::Text(texts.iter().map(|text| lossy(text.as_bytes())).collect())
        }
        TypeDescriptor::FixedAscii(_) => {
            let texts = attribute.read_raw::<FixedAscii<TEXT>>()?;
            Parameter::Text(texts.iter().map(|text| lossy(text.as_bytes())).collect())
        }
        TypeDescriptor::Integer(_) | TypeDescriptor::Unsigned(_) if attribute.is_scalar() => {
            Parameter::Integer(attribute.read_scalar()?)
        }
        _ if attribute.is_scalar() => Parameter::Number(attribute.read_scalar()?),
        _ => Parameter::Numbers(attribute.read_raw()?),
    })
}

/// A text that may be damaged.
fn lossy(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}
