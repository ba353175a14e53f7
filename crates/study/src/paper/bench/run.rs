//! One run of the daemon, from its output and its export.

use std::{
    fs,
    path::{Path, PathBuf},
    process::Command,
};

use rig_contact::Direction;
use serde::Deserialize;

use crate::outcome::StudyError;

/// The results of a run that the page uses.
#[derive(Debug)]
pub(super) struct BenchRun {
    pub(super) rig_seconds: f64,
    pub(super) no_load_hz: Option<f64>,
    pub(super) sensitivity_hz_per_mpa: Option<f64>,
    pub(super) touches: Vec<BenchTouch>,
}

/// A touch in the export of the daemon.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct BenchTouch {
    pub(super) is_blind: bool,
    /// Index of the true sample, also for a blind touch.
    pub(super) sample: usize,
    pub(super) direction: Direction,
    pub(super) angle_deg: f64,
    pub(super) shift_hz: f64,
    pub(super) shift_sigma_hz: f64,
    pub(super) indentation_mm: f64,
}

/// The last JSON object of `rigd run --json`.
#[derive(Debug, Deserialize)]
struct Printed {
    rig_seconds: f64,
    no_load_hz: Option<f64>,
    sensitivity_hz_per_mpa: Option<f64>,
    data: PathBuf,
}

/// A failed run of the daemon.
#[derive(Debug, thiserror::Error)]
enum BenchError {
    #[error("{} ended with {status}: {said}", program.display())]
    Failed { program: PathBuf, status: std::process::ExitStatus, said: String },
    #[error("{} line {line} is not a touch", path.display())]
    NotATouch { path: PathBuf, line: usize },
}

impl BenchRun {
    /// Runs a protocol and reads its touches.
    pub(super) fn of(rigd: &Path, protocol: &Path) -> Result<Self, StudyError> {
        let data = std::env::temp_dir().join(format!("rig-study-bench-{}", std::process::id()));
        let found = Self::run(rigd, protocol, &data);
        // The folder is temporary; its results have been read.
        let _ = fs::remove_dir_all(&data);
        found
    }

    fn run(rigd: &Path, protocol: &Path, data: &Path) -> Result<Self, StudyError> {
        let output = Command::new(rigd)
            .arg("run")
            .arg(protocol)
            .arg("--json")
            .arg("--data")
            .arg(data)
            .output()
            .map_err(|source| StudyError::File { path: rigd.to_owned(), source })?;
        if !output.status.success() {
            let said = String::from_utf8_lossy(&output.stderr).trim().to_owned();
            let (program, status) = (rigd.to_owned(), output.status);
            return Err(StudyError::arguments(BenchError::Failed { program, status, said }));
        }
        let printed: Printed = serde_json::from_slice(&output.stdout)?;
        let path = printed.data.join("touches.csv");
        let text = fs::read_to_string(&path)
            .map_err(|source| StudyError::File { path: path.clone(), source })?;
        let touches = touches(&text).map_err(|line| {
            StudyError::arguments(BenchError::NotATouch { path: path.clone(), line })
        })?;
        Ok(Self {
            rig_seconds: printed.rig_seconds,
            no_load_hz: printed.no_load_hz,
            sensitivity_hz_per_mpa: printed.sensitivity_hz_per_mpa,
            touches,
        })
    }
}

/// The cells of a line. Text stands in quotes; the cells that this page reads hold no comma.
fn cells(line: &str) -> Vec<&str> {
    line.split(',').map(|cell| cell.trim_matches('"')).collect()
}

/// The touches of an export, or the number of the first malformed line.
fn touches(text: &str) -> Result<Vec<BenchTouch>, usize> {
    let mut lines = text.lines();
    let columns = cells(lines.next().ok_or(1_usize)?);
    let index = |name: &str| columns.iter().position(|&column| column == name).ok_or(1_usize);
    let [phase, sample, direction, angle, shift, sigma, indentation] = [
        index("phase")?,
        index("sample")?,
        index("direction")?,
        index("angle_deg")?,
        index("shift_hz")?,
        index("shift_sigma_hz")?,
        index("indentation_mm")?,
    ];
    let touch = |line: &str| {
        let cells = cells(line);
        let number = |index: usize| cells.get(index)?.parse::<f64>().ok();
        let name = *cells.get(direction)?;
        Some(BenchTouch {
            is_blind: *cells.get(phase)? == "blind",
            // The protocol numbers its samples from one, softest first.
            sample: cells.get(sample)?.parse::<usize>().ok()?.checked_sub(1)?,
            direction: Direction::ALL.into_iter().find(|one| one.name() == name)?,
            angle_deg: number(angle)?,
            shift_hz: number(shift)?,
            shift_sigma_hz: number(sigma)?,
            indentation_mm: number(indentation)?,
        })
    };
    lines.enumerate().map(|(index, line)| touch(line).ok_or(index + 2)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEAD: &str =
        "step,phase,sample,direction,angle_deg,shift_hz,shift_sigma_hz,indentation_mm";

    #[test]
    fn touches_are_read_by_the_names_of_their_columns() {
        let text = format!(
            "{HEAD}\n\"main/1\",\"main\",\"1\",\"front\",0.0,7.9,0.003,0.5\n\
             \"b/1\",\"blind\",\"5\",\"left\",12.25,80.0,0.1,0.5\n"
        );
        let found = touches(&text).unwrap();
        assert_eq!(found.len(), 2);
        assert_eq!(
            found[1],
            BenchTouch {
                is_blind: true,
                sample: 4,
                direction: Direction::Left,
                angle_deg: 12.25,
                shift_hz: 80.0,
                shift_sigma_hz: 0.1,
                indentation_mm: 0.5,
            }
        );
        assert_eq!(touches(&format!("{HEAD}\nx,main,0,front,0,1,1,1\n")), Err(2));
        assert_eq!(touches("a,b\n"), Err(1));
    }
}
