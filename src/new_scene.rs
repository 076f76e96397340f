//! `gshear-mpi new`: writes a scene to start from.

use std::fs::{self, File};
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

use gshear_dem::failure::{Failure, Result};
use gshear_scene::templates::Template;

/// Writes a template into a new file, by default one of its name in the working directory. Returns
/// the path of the file.
///
/// # Errors
/// `Failure::Input` if the file is there or cannot be made; nothing is written then.
pub fn write(template: &Template, file: Option<&Path>) -> Result<PathBuf> {
    let name = format!("{}.toml", template.name);
    let path = file.map_or_else(|| PathBuf::from(name), Path::to_path_buf);
    let shown = path.display();
    if path.extension().is_none_or(|extension| extension != "toml") {
        return Err(Failure::input(format!(
            "{shown}: is no name of a scene; give one that ends with .toml"
        )));
    }
    let mut scene = File::create_new(&path).map_err(|why| match why.kind() {
        ErrorKind::AlreadyExists => Failure::input(format!(
            "{shown}: is there already; give the new scene another name: gshear-mpi new {} OTHER.toml",
            template.name
        )),
        _ => Failure::input(format!("{shown}: cannot be written: {why}; give another file")),
    })?;
    if let Err(why) = scene.write_all(template.text.as_bytes()) {
        let _ = fs::remove_file(&path);
        return Err(Failure::other(format!("{shown}: cannot be written: {why}")));
    }
    Ok(path)
}
