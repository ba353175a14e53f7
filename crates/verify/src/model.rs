//! χ² of the main touches under the model that a run states, with a beam and a contact of this crate.
//!
//! A run states the terms of its model and χ². Here each main touch is inverted again, by bisection of the
//! lowest resonance of a beam element in three motions, and χ² is added up again.

mod beam;
mod rest;

use std::{collections::BTreeMap, path::Path};

use serde::{Deserialize, Serialize};

use crate::{
    between::Between,
    journal::{self, Journal, JournalError},
    record::{Cited, Record, Resumed, RunStarted, Source, TouchResult},
};
use beam::{Beam, Contact, Law};

/// The model of a run as its results state it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StatedModel {
    /// Tangential over normal contact stiffness.
    pub tangential_ratio: f64,
    /// From the middle plane of the bimorph to the centre of the ball, mm.
    pub arm_mm: f64,
    /// Whether the stage holds the depth, while the sensor deflects.
    pub is_held_by_stage: bool,
    /// Number of terms that were fitted to the main touches.
    pub learnt: usize,
    /// χ² of the main touches for each degree of freedom.
    pub chi2_per_dof: f64,
    /// Number of degrees of freedom.
    pub degrees_of_freedom: usize,
}

/// The comparison of a stated χ² with that of this checker.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ModelCheck {
    /// Whether both agree; `None` when it was not computed.
    pub is_confirmed: Option<bool>,
    /// χ² for each degree of freedom by this checker.
    pub chi2_per_dof: Option<f64>,
    /// Number of degrees of freedom by this checker.
    pub degrees_of_freedom: Option<usize>,
    /// Why it was not computed.
    pub reason: Option<String>,
}

/// A stated χ² for each degree of freedom may differ by this part: the two beams treat the twist
/// differently, which changes it by 1e-5.
const CHI2_REL: f64 = 0.01;
/// The same in absolute terms, for a small χ².
const CHI2_LEAST: f64 = 0.005;

/// Computes χ² of the main touches of a run again. Nothing is written.
///
/// # Errors
/// [`JournalError`] if the journal cannot be read or has no such run.
pub fn verify_model(
    data: &Path,
    run: &str,
    stated: &StatedModel,
) -> Result<ModelCheck, JournalError> {
    let journal = journal::read(&journal::open(&data.join("rigd.db"))?, run)?;
    Ok(check(&journal, stated))
}

fn check(journal: &Journal, stated: &StatedModel) -> ModelCheck {
    let found = match chi2_of(journal, stated) {
        Ok(found) => found,
        Err(reason) => {
            return ModelCheck {
                is_confirmed: None,
                chi2_per_dof: None,
                degrees_of_freedom: None,
                reason: Some(reason.to_owned()),
            };
        }
    };
    let (chi2_per_dof, degrees_of_freedom) = found;
    let limit = CHI2_LEAST.max(CHI2_REL * chi2_per_dof);
    let agrees = (chi2_per_dof - stated.chi2_per_dof).abs() <= limit;
    ModelCheck {
        is_confirmed: Some(agrees && degrees_of_freedom == stated.degrees_of_freedom),
        chi2_per_dof: Some(chi2_per_dof),
        degrees_of_freedom: Some(degrees_of_freedom),
        reason: None,
    }
}

/// The keys of the protocol that say whether the angles are known, and when the reference is measured.
#[derive(Debug, Deserialize)]
struct ProtocolKeys {
    angle: Option<String>,
    no_load: Option<String>,
}

/// The keys of the rig file that describe the sensor.
#[derive(Debug, Deserialize)]
struct RigKeys {
    sensor: SensorKeys,
    geometry: GeometryKeys,
}

#[derive(Debug, Deserialize)]
struct GeometryKeys {
    probe_radius_mm: f64,
}

#[derive(Debug, Clone, Copy, Deserialize)]
struct SensorKeys {
    length_mm: f64,
    width_mm: f64,
    piezo_thickness_mm: f64,
    core_thickness_mm: f64,
    tip_mass_g: f64,
    tip_gyration_mm: f64,
    law: Law,
    poisson: f64,
    piezo: LayerKeys,
    core: LayerKeys,
    uncertainty: UncertaintyKeys,
}

#[derive(Debug, Clone, Copy, Deserialize)]
struct LayerKeys {
    modulus_gpa: f64,
    shear_gpa: f64,
    density_kg_per_m3: f64,
}

#[derive(Debug, Clone, Copy, Deserialize)]
struct UncertaintyKeys {
    depth_mm: f64,
    angle_deg: f64,
    sample_rel: f64,
}

/// The last result of each touch.
fn touches(journal: &Journal) -> Result<(RunStarted, Vec<TouchResult>), &'static str> {
    if journal.is_amended {
        return Err("touches of the run were measured again or left out");
    }
    let (mut started, mut touches, mut between) = (None, BTreeMap::new(), Between::default());
    let mut is_archived = false;
    for entry in journal.entries.iter().filter(|entry| entry.is_own) {
        is_archived |= entry.kind == "sweep" && entry.payload.is_empty();
        let Ok(record) = serde_json::from_str(&entry.payload) else { continue };
        between.take(&record);
        match record {
            Record::RunStarted(found) => started = Some(*found),
            Record::Resumed(resumed)
                if started.as_ref().is_some_and(|started| !rests_alike(started, &resumed)) =>
            {
                return Err("the run went on with another sensor or map of the screw");
            }
            Record::TouchResult(found) => {
                touches.insert(found.touch.step.clone(), *found);
            }
            // What was measured next may contradict a result.
            Record::TouchRefused(found) => {
                touches.remove(&found.touch.step);
            }
            _ => {}
        }
    }
    let started = started.ok_or("the run has no beginning")?;
    let mut touches: Vec<TouchResult> = touches.into_values().collect();
    if is_by_drift(&started)? {
        if is_archived {
            return Err("the sweeps between which its references lie are in an archive");
        }
        for touch in &mut touches {
            between.refer(touch);
        }
    }
    Ok((started, touches))
}

/// Whether the touches after a resumption rest on the same sensor and the same map of the screw as those at the beginning.
fn rests_alike(started: &RunStarted, resumed: &Resumed) -> bool {
    let sensor = |rig: &Source| -> Option<[Option<toml::Value>; 2]> {
        let rig: toml::Table = toml::from_str(&rig.toml).ok()?;
        let radius = rig.get("geometry").and_then(|geometry| geometry.get("probe_radius_mm"));
        Some([rig.get("sensor").cloned(), radius.cloned()])
    };
    let screw = |cited: &[Cited]| cited.iter().find_map(|cited| cited.screw.clone());
    resumed.rig.as_ref().is_none_or(|rig| sensor(rig) == sensor(&started.rig))
        && resumed
            .calibrations
            .as_ref()
            .is_none_or(|cited| screw(cited) == screw(&started.calibrations))
}

/// Whether the references of a run are measured when the drift asks for them.
fn is_by_drift(started: &RunStarted) -> Result<bool, &'static str> {
    let protocol = protocol(started)?;
    let chosen = started.aim.as_ref().map(|aim| aim.settings.no_load.as_str());
    Ok(chosen.or(protocol.no_load.as_deref()) == Some("by-drift"))
}

fn protocol(started: &RunStarted) -> Result<ProtocolKeys, &'static str> {
    toml::from_str(&started.protocol.toml).map_err(|_| "the protocol cannot be read")
}

/// χ² for each degree of freedom, and their number.
fn chi2_of(journal: &Journal, stated: &StatedModel) -> Result<(f64, usize), &'static str> {
    let (started, touches) = touches(journal)?;
    if protocol(&started)?.angle.as_deref() == Some("unknown") {
        return Err("the contact angles are unknown");
    }
    let rig: RigKeys = toml::from_str(&started.rig.toml)
        .map_err(|_| "the rig file does not describe the sensor in full")?;
    let beam = Beam::new(&rig.sensor, rig.geometry.probe_radius_mm, stated.arm_mm);
    let uncertainty = rig.sensor.uncertainty;
    let squares: f64 = touches.iter().map(|touch| touch.surface_sigma_mm.powi(2)).sum();
    let surface_mm = (squares / touches.len().max(1) as f64).sqrt();
    let screw = started.calibrations.iter().find_map(|cited| cited.screw.as_ref());
    let free_hz = beam.free_hz();
    // By sample, the weight and the logarithm of the stiffness of each touch.
    let mut samples: BTreeMap<String, Vec<(f64, f64)>> = BTreeMap::new();
    for touch in touches.iter().filter(|touch| touch.touch.phase == "main") {
        let by_map =
            screw.and_then(|screw| screw.error_of_depth_mm(touch.surface_mm, touch.linear_mm));
        let (error_mm, stage_mm) = by_map.unwrap_or((0.0, uncertainty.depth_mm));
        let depth_sigma_mm = stage_mm.hypot(surface_mm);
        let contact = Contact {
            direction: touch.touch.pose.direction.as_str().try_into()?,
            angle_rad: touch.touch.pose.angle_deg.to_radians(),
            depth_mm: touch.indentation_mm - error_mm,
            is_held_by_stage: stated.is_held_by_stage,
            tangential_ratio: stated.tangential_ratio,
        };
        let scale = free_hz / touch.no_load_hz;
        let Some(log) = beam.log_young(&contact, scale * touch.shift_hz) else { continue };
        let shift = |log: f64, contact: &Contact| beam.shift_hz(contact, log);
        let slope = |low: f64, high: f64, step: f64| (high - low) / (2.0 * step);
        let of = |by: f64| Contact { depth_mm: contact.depth_mm + by, ..contact };
        let per_mm = slope(shift(log, &of(-STEP_MM)), shift(log, &of(STEP_MM)), STEP_MM);
        let of = |by: f64| Contact { angle_rad: contact.angle_rad + by, ..contact };
        let per_rad = slope(shift(log, &of(-STEP_RAD)), shift(log, &of(STEP_RAD)), STEP_RAD);
        let per_log =
            slope(shift(log - STEP_LOG, &contact), shift(log + STEP_LOG, &contact), STEP_LOG);
        let angle_rad = uncertainty.angle_deg.to_radians();
        let parts = [scale * touch.shift_sigma_hz, per_mm * depth_sigma_mm, per_rad * angle_rad];
        let variance = parts.iter().map(|part| (part / per_log).powi(2)).sum::<f64>();
        let weight = 1.0 / (variance + uncertainty.sample_rel.powi(2));
        samples.entry(touch.touch.sample.clone()).or_default().push((weight, log));
    }
    let count: usize = samples.values().map(Vec::len).sum();
    let freedom = count.checked_sub(samples.len() + stated.learnt).filter(|freedom| *freedom > 0);
    let freedom = freedom.ok_or("the main touches leave no degree of freedom")?;
    let chi2: f64 = samples.values().map(|touches| about_mean(touches)).sum();
    Ok((chi2 / freedom as f64, freedom))
}

/// Steps of the numerical slopes.
const STEP_MM: f64 = 1e-4;
const STEP_RAD: f64 = 1e-4;
const STEP_LOG: f64 = 1e-4;

/// χ² of weighted values about their mean.
fn about_mean(values: &[(f64, f64)]) -> f64 {
    let weight: f64 = values.iter().map(|(weight, _)| weight).sum();
    let mean = values.iter().map(|(weight, log)| weight * log).sum::<f64>() / weight;
    values.iter().map(|(weight, log)| weight * (log - mean).powi(2)).sum()
}
