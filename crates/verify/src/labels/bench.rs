//! What a sweep states as known of the bench comes from the survey before it, and its level is that of the protocol.

use crate::{
    finding::{Check, Findings},
    record::{Bench, Sweep},
    settings::Protocol,
};

/// The bench of the last survey.
#[derive(Debug, Default)]
pub(super) struct BenchChain {
    last: Option<Bench>,
    /// The check of the level in the step of the survey.
    levels: Option<Levels>,
}

/// Sweeps by which the level is checked, as far as they state their level.
#[derive(Debug, Clone, Copy)]
struct Levels {
    /// Record of the survey.
    survey: u64,
    /// Whether the protocol asks for the check.
    is_asked: bool,
    /// Whether one was accepted at half the level, and whether the last one was at half.
    has_half: bool,
    is_half: bool,
}

impl BenchChain {
    pub(super) fn sweep(
        &mut self,
        seq: u64,
        sweep: &Sweep,
        is_accepted: bool,
        protocol: &Protocol,
        findings: &mut Findings,
    ) {
        self.level(seq, sweep, is_accepted, protocol, findings);
        let is_asked = protocol.no_load_sweep.survey_s.is_some();
        let stated = sweep.fit.as_ref().and_then(|fit| fit.bench);
        let number = sweep.number;
        match (self.last, stated) {
            (None, Some(_)) if sweep.purpose == "no_load" && is_asked => {
                // A refused survey is made again.
                self.last = stated.filter(|_| is_accepted);
                let levels = Levels {
                    survey: seq,
                    is_asked: protocol.no_load_sweep.level_check,
                    has_half: false,
                    is_half: false,
                };
                self.levels = sweep.level_v.filter(|_| is_accepted).map(|_| levels);
            }
            (None, None) if !(is_asked && is_accepted) => {}
            (last, stated) if last.is_some() && last == stated => {}
            (last, stated) => {
                let what = format!("sweep {number}: the bench is not that of the survey before it");
                findings.add(Check::Request, seq, what, format!("{last:?}"), format!("{stated:?}"));
            }
        }
    }

    /// A sweep is at the level of the protocol. Behind a survey, it may be at half of it.
    fn level(
        &mut self,
        seq: u64,
        sweep: &Sweep,
        is_accepted: bool,
        protocol: &Protocol,
        findings: &mut Findings,
    ) {
        let is_no_load = sweep.purpose == "no_load";
        let asked = if is_no_load { &protocol.no_load_sweep } else { &protocol.contact_sweep };
        // Older journals do not say it.
        let (Some(asked_v), Some(level_v)) = (asked.level_v, sweep.level_v) else { return };
        let levels = self.levels.as_mut().filter(|levels| levels.is_asked && is_no_load);
        let is_half = level_v == 0.5 * asked_v;
        if level_v != asked_v && !(is_half && levels.is_some()) {
            let what = format!("the level of sweep {}, V", sweep.number);
            findings.add(Check::Request, seq, what, asked_v, level_v);
        }
        if let Some(levels) = levels {
            levels.has_half |= is_half && is_accepted;
            levels.is_half = is_half;
        }
    }

    /// The step of a survey is over: the level was checked in it, and the reference is at the full one.
    pub(super) fn step_started(&mut self, findings: &mut Findings) {
        let Some(levels) = self.levels.take().filter(|levels| levels.is_asked) else { return };
        let found = match levels {
            Levels { has_half: false, .. } => "no sweep at half the level",
            Levels { is_half: true, .. } => "the last sweep at half the level",
            _ => return,
        };
        let what = "the check of the level after a survey";
        findings.add(Check::Request, levels.survey, what, "sweeps at both levels in turn", found);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sweeps behind a survey at these levels, V, and the number of findings until the next step.
    fn findings(level_check: bool, levels_v: &[f64]) -> usize {
        let sweep = |purpose: &str, level_v: f64, bench: bool| -> Sweep {
            let bench = bench.then(|| {
                serde_json::json!({
                    "phase_rad": 0.0, "phase_sigma_rad": 0.001, "first_gap_s": 0.0, "dispersion_f": 0.0,
                    "dispersion_sigma_f": 0.0, "mode_sigma": 0.01, "surveyed_hz": [125.0, 160.0],
                })
            });
            let sweep = serde_json::json!({
                "number": 1, "purpose": purpose, "level_v": level_v, "readings": [], "probe_readings": 0,
                "fit": {
                    "window_hz": [125.0, 160.0], "timing": "unknown", "always_loss": false, "bench": bench,
                },
                "outcome": { "status": "accepted", "resonance_hz": 140.0, "sigma_hz": 0.01 },
            });
            serde_json::from_value(sweep).expect("a sweep")
        };
        let text = include_str!("../../../../config/protocols/three-direction.toml");
        let mut protocol: Protocol = toml::from_str(text).expect("a protocol");
        (protocol.no_load_sweep.survey_s, protocol.no_load_sweep.level_check) =
            (Some(10), level_check);
        let (mut chain, mut findings) = (BenchChain::default(), Findings::default());
        for (index, level_v) in [5.0].iter().chain(levels_v).enumerate() {
            let sweep = sweep("no_load", *level_v, true);
            chain.sweep(index as u64, &sweep, true, &protocol, &mut findings);
        }
        chain.step_started(&mut findings);
        chain.sweep(100, &sweep("touch", 5.0, true), true, &protocol, &mut findings);
        findings.0.len()
    }

    #[test]
    fn the_level_is_that_of_the_protocol_but_where_it_is_checked() {
        for (level_check, levels_v, expected) in [
            (false, &[][..], 0),
            (false, &[2.5], 1),
            (true, &[2.5, 5.0], 0),
            (true, &[], 1),
            (true, &[5.0], 1),
            (true, &[2.5], 1),
            (true, &[2.5, 3.0, 5.0], 1),
        ] {
            assert_eq!(findings(level_check, levels_v), expected, "{level_check}, {levels_v:?}");
        }
    }
}
