//! Directories that outlive a power cut.

use std::{
    fs::{self, File},
    io,
    path::Path,
};

/// Makes a directory, and those above it, where they are missing. The disk has their names then: what is flushed
/// within a directory is lost with the directory if that is not.
///
/// # Errors
/// [`io::Error`] of a directory that cannot be made or flushed.
pub fn make_directory(directory: &Path) -> io::Result<()> {
    let missing: Vec<_> = directory
        .ancestors()
        .take_while(|above| !above.as_os_str().is_empty() && !above.is_dir())
        .collect();
    fs::create_dir_all(directory)?;
    for made in missing {
        let above = made.parent().filter(|above| !above.as_os_str().is_empty());
        File::open(above.unwrap_or(Path::new(".")))?.sync_all()?;
    }
    Ok(())
}
