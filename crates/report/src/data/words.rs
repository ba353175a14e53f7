//! Records of the log in words.

use rig_record::{
    BlackBox, Clearance, ClockJumped, Fault, Prompt, ReferenceJumped, RefusalAnswered,
    RetractTried, Stalled,
};

use crate::units::fixed;

/// A fault in words.
pub(super) fn faulted(Fault { cause, probe, hint, .. }: &Fault) -> String {
    format!("{cause}. The probe was {}. {hint}", whereabouts(*probe))
}

/// A jump of the free resonance in words.
pub(super) fn jump(ReferenceJumped { off_hz, sigma_hz, touches, .. }: &ReferenceJumped) -> String {
    let (off, sigma) = (fixed(*off_hz, 3), fixed(*sigma_hz, 3));
    format!(
        "the no-load resonance is {off} Hz from where its drift lets it be expected (± {sigma} Hz); touched since the \
         reference before: {}",
        touches.join(", ")
    )
}

/// The answer about a refused touch in words.
pub(super) fn decided(RefusalAnswered { reason, answer, by, .. }: &RefusalAnswered) -> String {
    format!("the touch was refused ({reason}); {by}: {answer}")
}

pub(super) fn retract_tried(RetractTried { attempt, cause, .. }: &RetractTried) -> String {
    let end = cause.as_deref().unwrap_or("the probe is clear");
    format!("attempt {attempt} to retract: {end}")
}

pub(super) fn kept_frames(BlackBox { frames, port }: &BlackBox) -> String {
    format!("the last frames on {port} are in the journal ({})", frames.len())
}

pub(super) fn clock_set(ClockJumped { jump_s }: ClockJumped) -> String {
    format!("the wall clock was set by {jump_s:+.1} s")
}

/// A hold-up in words.
pub(super) fn held_up(stalled: &Stalled) -> String {
    let again = if stalled.is_measured_again { "; its readings were measured again" } else { "" };
    format!("rigd was held up for {:.1} s{again}", stalled.stalled_s)
}

/// A prompt in words.
pub(super) fn request(prompt: &Prompt) -> String {
    match prompt {
        Prompt::PlaceSample { sample } => format!("place sample {sample} under the probe"),
        Prompt::TurnSensor { orientation } => {
            format!("turn the sensor to its {orientation} position")
        }
    }
}

/// The clearance of the probe in words.
const fn whereabouts(probe: Clearance) -> &'static str {
    match probe {
        Clearance::Clear => "clear",
        Clearance::InContact => "lowered, and may be in contact",
        Clearance::Unknown => "at an unknown position",
    }
}
