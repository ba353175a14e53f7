//! The file of judged designs, from which an interrupted study continues.

use std::{
    fs::{self, File, OpenOptions},
    io::{ErrorKind, Write as _},
    path::{Path, PathBuf},
};

use super::{
    grid::{Design, Grid},
    merit::Merit,
};
use crate::{files::Csv, outcome::StudyError};

const COLUMNS: [&str; 8] = [
    "length_mm",
    "radius_mm",
    "indentation_mm",
    "arm_mm",
    "angle_influence_percent",
    "discrimination_percent",
    "sensitivity_hz_per_mpa",
    "point_s",
];

/// The file with the designs of its complete blocks.
pub(super) struct Rows {
    path: PathBuf,
    file: File,
    designs: Vec<(Design, Option<Merit>)>,
    blocks_done: usize,
}

impl Rows {
    /// Opens the file of a study. Complete blocks of the same grid are kept; other content is
    /// dropped.
    pub(super) fn open(path: &Path, grid: &Grid) -> Result<Self, StudyError> {
        let wrong = |source| StudyError::File { path: path.to_owned(), source };
        let before = match fs::read_to_string(path) {
            Ok(text) => text,
            Err(error) if error.kind() == ErrorKind::NotFound => String::new(),
            Err(error) => return Err(wrong(error)),
        };
        let head = head(grid);
        let mut designs = Vec::new();
        let mut blocks_done = 0;
        let mut kept = head.clone();
        if let Some(rows) = before.strip_prefix(&head) {
            let mut lines = rows.split_inclusive('\n').filter(|line| line.ends_with('\n'));
            for block in grid.blocks() {
                let found: Vec<&str> = lines.by_ref().take(block.len()).collect();
                if found.len() < block.len() {
                    break;
                }
                designs.extend(block.iter().zip(&found).map(|(design, line)| {
                    let cells: Vec<&str> = line.trim_end().split(',').skip(4).collect();
                    (*design, Merit::of_cells(&cells))
                }));
                kept.extend(found);
                blocks_done += 1;
            }
        }
        fs::write(path, &kept).map_err(wrong)?;
        let file = OpenOptions::new().append(true).open(path).map_err(wrong)?;
        Ok(Self { path: path.to_owned(), file, designs, blocks_done })
    }

    /// Number of complete blocks in the file.
    pub(super) const fn blocks_done(&self) -> usize {
        self.blocks_done
    }

    /// Adds a block to the file.
    pub(super) fn append(&mut self, judged: &[(Design, Option<Merit>)]) -> Result<(), StudyError> {
        self.file
            .write_all(lines(judged).as_bytes())
            .map_err(|source| StudyError::File { path: self.path.clone(), source })?;
        // Rounded as in the file, so that an interrupted study ends with the same bytes.
        self.designs.extend(judged.iter().map(|(design, merit)| {
            let rounded = merit.and_then(|merit| {
                let cells = merit.cells();
                Merit::of_cells(&cells.each_ref().map(String::as_str))
            });
            (*design, rounded)
        }));
        Ok(())
    }

    /// All designs, in the order of the grid.
    pub(super) fn into_designs(self) -> Vec<(Design, Option<Merit>)> {
        self.designs
    }
}

/// The first lines of the file.
fn head(grid: &Grid) -> String {
    format!("# {grid}\n{}\n", COLUMNS.join(","))
}

/// Writes the file with the lines of all blocks, as a whole, in the place of the one that may be there.
pub(super) fn write(path: &Path, grid: &Grid, blocks: &[String]) -> Result<(), StudyError> {
    let text = head(grid) + &blocks.concat();
    let begun = path.with_extension(format!("{}.csv", std::process::id()));
    fs::write(&begun, text)
        .and_then(|()| fs::rename(&begun, path))
        .map_err(|source| StudyError::File { path: path.to_owned(), source })
}

/// The lines of a block.
pub(super) fn lines(judged: &[(Design, Option<Merit>)]) -> String {
    judged.iter().map(row).collect()
}

/// A table of designs.
pub(super) fn table<'a>(designs: impl Iterator<Item = &'a (Design, Option<Merit>)>) -> String {
    let mut text = Csv::new(&COLUMNS).text().to_owned();
    text.extend(designs.map(row));
    text
}

/// A row of the table. A design outside the models has no merits.
fn row((design, merit): &(Design, Option<Merit>)) -> String {
    let Design { length_mm, radius_mm, indentation_mm, arm_mm, .. } = design;
    let merits = merit.map_or_else(|| ",,,".to_owned(), |merit| merit.cells().join(","));
    format!("{length_mm:.6},{radius_mm:.6},{indentation_mm:.6},{arm_mm:.6},{merits}\n")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::paper_bench::Control;

    fn grid(lengths: &str) -> Grid {
        Grid {
            lengths_mm: lengths.parse().unwrap(),
            radii_mm: "0.2:1:3".parse().unwrap(),
            indentations_mm: "0.5".parse().unwrap(),
            arms_mm: "8".parse().unwrap(),
            control: Control::Indentation,
        }
    }

    fn finish(path: &Path, grid: &Grid, blocks: usize) -> usize {
        let mut rows = Rows::open(path, grid).unwrap();
        let done = rows.blocks_done();
        for block in grid.blocks().iter().skip(done).take(blocks) {
            let judged: Vec<_> = block.iter().map(|design| (*design, Merit::of(design))).collect();
            rows.append(&judged).unwrap();
        }
        done
    }

    /// A file cut at any byte is completed to the same bytes.
    #[test]
    fn an_interrupted_study_ends_with_the_same_bytes() {
        let folder = std::env::temp_dir().join(format!("rig-study-rows-{}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        let path = folder.join("design.csv");
        let grid = grid("20:50:3");
        finish(&path, &grid, 3);
        let whole = fs::read(&path).unwrap();
        for cut in 0..=whole.len() {
            fs::write(&path, &whole[..cut]).unwrap();
            finish(&path, &grid, 3);
            assert_eq!(fs::read(&path).unwrap(), whole, "cut at {cut}");
        }
        assert_eq!(finish(&path, &grid, 3), 3, "nothing is left to do");
        // Another grid starts from the beginning.
        assert_eq!(finish(&path, &super::tests::grid("20:40:3"), 3), 0);
        fs::remove_dir_all(&folder).unwrap();
    }

    /// A ball of 0.2 mm at a depth of 0.5 mm is beyond the contact law.
    #[test]
    fn a_design_outside_of_the_models_has_a_row_without_merits() {
        let design = grid("35").blocks()[0][0];
        assert_eq!(Merit::of(&design), None);
        assert_eq!(row(&(design, None)), "35.000000,0.200000,0.500000,8.000000,,,,\n");
    }
}
