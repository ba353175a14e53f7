//! One run with a setting.

use std::{collections::BTreeMap, fs};

use rig_report::{TouchRow, TouchStatus};
use rigd::{loaded_rig::LoadedRig, protocol_file::LoadedProtocol};
use tempfile::TempDir;

use super::setting::{Files, Scene, Setting};
use crate::bench_run::{BenchError, BenchRun};

/// What a run made of its touches.
#[derive(Debug, Clone)]
pub(super) struct Trial {
    pub(super) rig_seconds: f64,
    pub(super) planned: usize,
    pub(super) refused: usize,
    /// The touches that were not made, because the run ended before.
    pub(super) not_reached: usize,
    /// Why the run ended before its last touch.
    pub(super) ended: Option<String>,
    /// For each stiffness: its logarithm less that of the touched point, and its stated standard deviation.
    pub(super) errors: Vec<(f64, f64)>,
    /// Time in each phase, s.
    pub(super) phases_s: BTreeMap<&'static str, f64>,
    /// What must never happen on a bench.
    pub(super) violations: Vec<String>,
}

impl Trial {
    pub(super) fn play(
        files: &Files,
        setting: &Setting,
        scene: Scene,
        seed: u32,
    ) -> Result<Self, BenchError> {
        let folder = TempDir::new()?;
        let path = |name: &str| folder.path().join(name);
        let names = ["protocol.toml", "rig.toml", "scene.toml"];
        for (name, text) in names.iter().zip(files.changed(setting, scene, seed)) {
            fs::write(path(name), text)?;
        }
        let rig = LoadedRig::load(&path(names[1]))?;
        let protocol = LoadedProtocol::load(&path(names[0]), &rig.facts())?;
        Ok(Self::of(&BenchRun::of(rig, protocol)?))
    }

    fn of(run: &BenchRun) -> Self {
        let touches = run.results.touches();
        let count = |status| touches.iter().filter(|row| row.status == status).count();
        let error = |row: &TouchRow| {
            let (found, sigma) = (row.stiffness_mpa?, row.stiffness_sigma_mpa?);
            Some(((found / run.true_mpa.get(&row.step)?).ln(), sigma / found))
        };
        Self {
            rig_seconds: run.results.summary().rig_seconds,
            planned: touches.len(),
            refused: count(TouchStatus::Refused),
            not_reached: count(TouchStatus::NotReached),
            ended: touches
                .iter()
                .find(|row| row.status == TouchStatus::NotReached)
                .map(|row| row.reason.clone().unwrap_or_default()),
            errors: touches.iter().filter_map(error).collect(),
            phases_s: run.phases_s.clone(),
            violations: run.violations.clone(),
        }
    }

    /// Rig time for each planned touch, s; `None` if the run ended before its end.
    pub(super) fn touch_s(&self) -> Option<f64> {
        (self.not_reached == 0 && self.planned > 0).then(|| self.rig_seconds / self.planned as f64)
    }
}
