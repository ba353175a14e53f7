//! The calibrations that a run cites: the files that are there are the cited ones, and the map of the screw is that of its
//! file. The depth of a touch by this map, which [`crate::model`] uses.

use std::path::Path;

use serde::Deserialize;
use sha2::{Digest, Sha256};

use crate::{
    chain::hex,
    finding::{Check, Findings},
    record::{Cited, Screw},
};

/// The keys of the file of a calibration that have the map.
#[derive(Debug, Deserialize)]
struct CalibrationKeys {
    verdict: String,
    /// The runs that were evaluated.
    #[serde(default)]
    journal: Vec<String>,
    #[serde(default)]
    screw_mm: Vec<[f64; 3]>,
    #[serde(default)]
    screw_covariance_um2: Vec<Vec<f64>>,
}

/// Checks what a run says of its calibrations.
pub(crate) fn check(cited: &[Cited], seq: u64, findings: &mut Findings) {
    for Cited { kind, file, screw, .. } in cited {
        let Some(screw) = screw else { continue };
        if kind != "blocks" {
            let what = format!("the kind of the calibration {file} with a map of the screw");
            findings.add(Check::Calibration, seq, what, "blocks", kind);
        }
        if !screw.is_map() {
            let what = format!("the map of the screw from {file}");
            let expected = "heights that grow, an error of each and a triangle of covariances";
            findings.add(Check::Calibration, seq, what, expected, "other lists");
        }
    }
}

/// A cited map that is the one of its file.
#[derive(Debug)]
pub(crate) struct FiledMap<'a> {
    /// Name of the file.
    pub(crate) file: &'a str,
    /// The map.
    pub(crate) screw: &'a Screw,
    /// Ids of the runs from whose touches it was made.
    pub(crate) runs: Vec<String>,
}

/// Compares the cited calibrations with the files as `read` gives them by their names. Those that are not there are not
/// compared. Returns the maps that are those of their files.
pub(crate) fn check_files<'a>(
    cited: &'a [Cited],
    read: impl Fn(&str) -> Option<String>,
    findings: &mut Findings,
) -> Vec<FiledMap<'a>> {
    let mut maps = Vec::new();
    for Cited { file, sha256, screw, .. } in cited {
        let is_name = Path::new(file).file_name().is_some_and(|name| name == file.as_str());
        if !is_name {
            let what = "the name of the file of a calibration";
            findings.add(Check::Calibration, 1, what, "a name without a folder", file);
            continue;
        }
        let Some(text) = read(file) else { continue };
        let found = hex(&Sha256::digest(text.as_bytes()));
        if found != *sha256 {
            let what = format!("SHA-256 of the calibration {file}");
            findings.add(Check::Calibration, 1, what, sha256, found);
            continue;
        }
        let Some(screw) = screw else { continue };
        match toml::from_str::<CalibrationKeys>(&text) {
            Ok(keys) if keys.has(screw) => {
                maps.push(FiledMap { file, screw, runs: keys.journal });
            }
            _ => {
                let what = format!("the map of the screw from {file}");
                findings.add(Check::Calibration, 1, what, "that of the accepted file", "another");
            }
        }
    }
    maps
}

impl CalibrationKeys {
    fn has(&self, screw: &Screw) -> bool {
        let column = |index: usize| self.screw_mm.iter().map(move |row| row[index]);
        self.verdict == "accepted"
            && column(0).eq(screw.heights_mm.iter().copied())
            && column(1).eq(screw.errors_mm.iter().copied())
            && self.screw_covariance_um2 == screw.covariance_um2
    }
}

impl Screw {
    /// Whether the lists are a map.
    pub(crate) fn is_map(&self) -> bool {
        let Self { heights_mm, errors_mm, covariance_um2 } = self;
        let grow = heights_mm.windows(2).all(|pair| pair[0] < pair[1]);
        let is_triangle = covariance_um2.iter().enumerate().all(|(index, row)| {
            row.len() == index + 1 && row.iter().all(|entry| entry.is_finite()) && row[index] >= 0.0
        });
        let count = heights_mm.len();
        let all = heights_mm.iter().chain(errors_mm);
        count >= 2
            && [errors_mm.len(), covariance_um2.len()] == [count; 2]
            && grow
            && is_triangle
            && all.into_iter().all(|value| value.is_finite())
    }

    /// What the depth by the drive from one position to another is too large, and its standard deviation, mm; `None`
    /// where one end is outside of the map.
    pub(crate) fn error_of_depth_mm(&self, from_mm: f64, to_mm: f64) -> Option<(f64, f64)> {
        if !self.is_map() {
            return None;
        }
        let mut weights = vec![0.0; self.heights_mm.len()];
        for (at_mm, sign) in [(from_mm, 1.0), (to_mm, -1.0)] {
            let inside = |pair: &[f64]| pair[0] <= at_mm && at_mm <= pair[1];
            let cell = self.heights_mm.windows(2).position(inside)?;
            let [low, high] = [self.heights_mm[cell], self.heights_mm[cell + 1]];
            let part = (at_mm - low) / (high - low);
            weights[cell] += sign * (1.0 - part);
            weights[cell + 1] += sign * part;
        }
        let error = weights.iter().zip(&self.errors_mm).map(|(by, error)| by * error).sum();
        let mut variance_um2 = 0.0;
        for (i, row) in self.covariance_um2.iter().enumerate() {
            for (j, entry) in row.iter().enumerate() {
                let twice = if i == j { 1.0 } else { 2.0 };
                variance_um2 += twice * weights[i] * weights[j] * entry;
            }
        }
        Some((error, 1e-3 * variance_um2.max(0.0).sqrt()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The errors of 10 and 20 µm, 0.1 mm apart, with 3 of 4 µm² in common, as in the tests of the analysis.
    fn screw() -> Screw {
        Screw {
            heights_mm: vec![1.0, 1.1],
            errors_mm: vec![0.01, 0.02],
            covariance_um2: vec![vec![4.0], vec![3.0, 4.0]],
        }
    }

    #[test]
    fn a_depth_has_the_difference_of_its_ends_and_what_they_do_not_share() {
        let (error, sigma) = screw().error_of_depth_mm(1.1, 1.0).unwrap();
        assert!((error - 0.01).abs() < 1e-12 && (sigma - 0.001 * 2.0_f64.sqrt()).abs() < 1e-12);
        assert_eq!(screw().error_of_depth_mm(1.1, 0.99), None);
        assert_eq!(screw().error_of_depth_mm(1.2, 1.0), None);
        let broken = Screw { errors_mm: vec![0.01], ..screw() };
        assert_eq!(broken.error_of_depth_mm(1.1, 1.0), None);
    }

    #[test]
    fn a_file_that_was_changed_or_has_another_map_is_a_finding() {
        let text = "verdict = \"accepted\"\nscrew_mm = [[1.0, 0.01, 0.002], [1.1, 0.02, 0.002]]\n\
                    screw_covariance_um2 = [[4.0], [3.0, 4.0]]\n";
        let sha256 = hex(&Sha256::digest(text.as_bytes()));
        let count = |screw: Screw, file: &str, text: Option<&str>| {
            let (kind, sha256) = ("blocks".to_owned(), sha256.clone());
            let (file, made) = (file.to_owned(), String::new());
            let screw = Some(screw);
            let cited = Cited { kind, made, file, sha256, verdict: None, screw, cable: None };
            let mut findings = Findings::default();
            check_files(&[cited], |_| text.map(str::to_owned), &mut findings);
            findings.0.len()
        };
        let name = "blocks-1.toml";
        assert_eq!(count(screw(), name, None), 0, "it is not there");
        assert_eq!(count(screw(), name, Some(text)), 0);
        assert_eq!(count(screw(), "../blocks-1.toml", Some(text)), 1);
        let other = Screw { errors_mm: vec![0.01, 0.021], ..screw() };
        assert_eq!(count(other, name, Some(text)), 1);
        assert_eq!(count(screw(), name, Some(&text.replace("accepted", "failed"))), 1);
    }
}
