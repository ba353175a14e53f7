//! A descent belongs to the touch under way, and its surface to its readings.

use super::{Labels, SweepFacts};
use crate::{
    descent::{self, Free},
    finding::Findings,
    motion::Motion,
    record::{Circuit, Descended, SurfaceFound},
    settings::Settings,
};

impl Labels {
    pub(crate) fn descended(
        &mut self,
        seq: u64,
        rig_us: u64,
        descended: Descended,
        motion: &Motion,
        settings: Option<&Settings>,
        findings: &mut Findings,
    ) {
        let search = ("approach", &*descended.step, &descended.pose, &[][..]);
        self.searched(seq, rig_us, search, motion, settings, findings);
        self.check_frequencies(seq, &descended.readings, findings);
        if let Some(settings) = settings {
            descent::check(seq, rig_us, &descended, &settings.protocol, findings);
        }
        // A rigd that was held up ends the descent, so that its readings are not used. Earlier versions called that late.
        if !["late", "held_up"].contains(&&*descended.end) {
            self.check_standstills(seq, &descended.readings, findings);
        }
        self.descended = Some(descended);
    }

    /// The descent has not found the surface.
    pub(crate) fn searches_in_steps(&mut self) {
        self.descended = None;
    }

    /// The surface of a descent is where its readings show it.
    pub(super) fn surface_of_descent(
        &self,
        seq: u64,
        found: &SurfaceFound,
        descended: &Descended,
        settings: &Settings,
        findings: &mut Findings,
    ) {
        let free = self.reference.as_ref().and_then(free);
        descent::check_surface(seq, found, descended, free, &settings.protocol, findings);
    }
}

/// The free sensor as its last reference shows it.
fn free(reference: &SweepFacts) -> Option<Free> {
    let (resonance_hz, _) = *reference.outcome.as_ref().ok()?;
    let Circuit { quality_factor, static_capacitance_f, capacitance_ratio, loss_tangent } =
        reference.circuit?;
    Some(Free {
        resonance_hz,
        quality: quality_factor,
        capacitance_f: static_capacitance_f,
        ratio: capacitance_ratio,
        loss: loss_tangent,
    })
}
