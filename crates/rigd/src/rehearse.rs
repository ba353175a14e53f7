//! A rehearsal: a protocol on a copy of a rig with simulated devices, once without a fault and once with
//! each fault of the menu, in virtual time.
//!
//! The journals are in memory, and no port of the rig is opened. The person of the rehearsal removes the
//! cause of a fault, starts rigd again where that is needed, acknowledges, and resumes the run.

mod bench;
mod menu;
mod play;

use std::io;

use rig_model::{RigTime, random::Stream};
use rig_store::{Action, Axis, MoveReason, Record, StoreError, StoredRecord};

use self::{
    menu::{MENU, Trouble},
    play::Play,
};
use crate::{
    loaded_rig::LoadedRig,
    protocol_file::LoadedProtocol,
    rig::{OpenError, RequestRefusal},
};

/// The name of the stream that draws the moments at which the faults happen.
const MOMENTS: u64 = 0x5eed;

/// Standard deviations beyond which two shifts differ.
const DIFFERENT_SIGMAS: f64 = 6.0;

/// Part of a shift by which it may differ because the sample was placed again.
const PLACED_AGAIN_REL: f64 = 0.2;

/// A rehearsal.
#[derive(Debug, Clone)]
pub struct Rehearsal {
    /// Number of touches of the protocol.
    pub touches: usize,
    /// Duration of the run without a fault, on the rig's clock, s.
    pub undisturbed_s: f64,
    /// One row for each fault.
    pub rows: Vec<RehearsedFault>,
}

/// The run with one fault.
#[derive(Debug, Clone)]
pub struct RehearsedFault {
    /// Number of the fault in the list of faults.
    pub number: u8,
    /// The fault in a few words.
    pub what: &'static str,
    /// What the rig was doing.
    pub phase: &'static str,
    /// The messages that a person would have seen, each with its advice.
    pub seen: Vec<String>,
    /// Number of touches that were refused.
    pub refused: usize,
    /// Number of touches that were begun again.
    pub repeated: usize,
    /// Number of accepted touches whose shift differs from that without the fault: by 6 standard
    /// deviations, and if samples were placed again, also by 20 %.
    pub different: usize,
    /// Number of times that rigd was started again.
    pub restarted: u32,
    /// Number of prompts that were answered beyond those of the protocol.
    pub answered_again: usize,
    /// Number of times that the person acknowledged a fault and resumed the run.
    pub resumed: u32,
    /// Whether the run came to its end.
    pub is_complete: bool,
    /// Whether the probe was clear in the end.
    pub is_clear: bool,
    /// Additional time of the rig, s.
    pub additional_s: f64,
}

/// Why a rehearsal is not possible.
#[derive(Debug, thiserror::Error)]
pub enum RehearseError {
    /// The simulated rig cannot be opened.
    #[error(transparent)]
    Open(#[from] OpenError),
    /// The run cannot be begun.
    #[error(transparent)]
    Refused(#[from] RequestRefusal),
    /// The journal of the rehearsal cannot be read.
    #[error("the journal of the rehearsal cannot be read")]
    Store(#[from] StoreError),
    /// The system gives no runtime.
    #[error("the system gives no runtime for the rehearsal")]
    Runtime(#[source] io::Error),
    /// The run without a fault does not come to its end, so that nothing can be compared with it.
    #[error("the run without a fault does not come to its end on the simulated bench: {reason}")]
    Undisturbed {
        /// Its fault or its end.
        reason: String,
    },
}

/// An accepted frequency shift, Hz.
#[derive(Debug, Clone, Copy)]
struct Shift {
    shift_hz: f64,
    sigma_hz: f64,
}

impl Shift {
    fn differs(self, known: Self, is_placed_again: bool) -> bool {
        let difference_hz = (self.shift_hz - known.shift_hz).abs();
        let placed_hz = if is_placed_again { PLACED_AGAIN_REL * known.shift_hz.abs() } else { 0.0 };
        difference_hz > placed_hz.max(DIFFERENT_SIGMAS * self.sigma_hz.hypot(known.sigma_hz))
    }
}

/// Rehearses a protocol; `progress` is told the number of each run before it begins, and the number of
/// all. `seed` decides at which moments the faults happen.
///
/// # Errors
/// [`RehearseError`].
pub fn rehearse(
    rig: &LoadedRig,
    protocol: &LoadedProtocol,
    seed: u64,
    mut progress: impl FnMut(usize, usize),
) -> Result<Rehearsal, RehearseError> {
    progress(0, MENU.len());
    let undisturbed = Play::of(rig, protocol, None)?;
    if !undisturbed.is_complete {
        let reason = undisturbed.seen.first().cloned();
        return Err(RehearseError::Undisturbed { reason: reason.unwrap_or_default() });
    }
    let mut rows = Vec::new();
    for (index, fault) in MENU.iter().enumerate() {
        progress(index + 1, MENU.len());
        let moments = match fault.trouble {
            Trouble::Frame { port, .. } => undisturbed.frames[port as usize].len(),
            Trouble::Disk(_) | Trouble::Kill => undisturbed.records.len(),
            Trouble::Late | Trouble::Absent | Trouble::Wrong => undisturbed.answers,
        };
        let moment = Stream::of_trial(seed, MOMENTS, index as u64).below(moments.max(1));
        let run = Play::of(rig, protocol, Some((fault.trouble, moment)))?;
        let answered_again = run.answers.saturating_sub(undisturbed.answers);
        let is_different = |(step, shift): (&String, &Shift)| {
            let known = undisturbed.shifts.get(step);
            known.is_some_and(|known| shift.differs(*known, answered_again > 0))
        };
        let phase = match fault.trouble {
            Trouble::Late | Trouble::Absent | Trouble::Wrong => "prompt",
            Trouble::Frame { port, .. } => {
                phase(&run.records, run.frames[port as usize].get(moment).copied())
            }
            Trouble::Disk(_) | Trouble::Kill => phase(&run.records, run.struck),
        };
        rows.push(RehearsedFault {
            number: fault.number,
            what: fault.what,
            phase,
            refused: run.refused.saturating_sub(undisturbed.refused),
            repeated: run.begun.saturating_sub(undisturbed.begun),
            different: run.shifts.iter().filter(|&touch| is_different(touch)).count(),
            restarted: run.restarted,
            answered_again,
            resumed: run.resumed,
            is_complete: run.is_complete,
            is_clear: run.is_clear,
            additional_s: run.took_s - undisturbed.took_s,
            seen: run.seen,
        });
    }
    let touches = protocol.summary.touches;
    Ok(Rehearsal { touches, undisturbed_s: undisturbed.took_s, rows })
}

/// What the rig was doing at a time, from the records before it.
fn phase(records: &[StoredRecord], at: Option<RigTime>) -> &'static str {
    let at = at.unwrap_or(RigTime::ZERO);
    let before = records.iter().take_while(|stored| stored.rig_us <= at.as_micros());
    let mut phase = "before the run";
    for stored in before {
        phase = match stored.record() {
            Ok(Record::StepStarted(step)) => match step.action {
                Action::Prompt { .. } => "prompt",
                Action::NoLoad { .. } => "no-load sweep",
                Action::Touch { .. } => "turn",
            },
            Ok(Record::Intent(intent)) => match intent.what {
                MoveReason::Approach => "search",
                _ => "indentation",
            },
            Ok(Record::Moved(moved)) if moved.axis == Axis::LinearMm && moved.is_clear => "clear",
            Ok(Record::Moved(moved)) if moved.axis == Axis::LinearMm && phase == "indentation" => {
                "contact sweep"
            }
            Ok(Record::Sweep(_)) if phase == "contact sweep" => "retract",
            _ => phase,
        };
    }
    phase
}
