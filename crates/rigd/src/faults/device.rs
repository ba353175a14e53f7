//! Faults of devices, of the sensor and of the sample.

use rig_analyzer::AnalyzerError;
use rig_engine::{ContactSenseFault, Fault, TouchRefusal};
use rig_model::{Position, ReadingFlag};
use rig_resonance::{Reason, Refusal};
use rig_stage::StageError;

use super::{
    FaultClass::Device,
    ListedFault, Seen,
    examples::{alarmed, analyzer, analyzer_port, at, linear, wrong_instrument},
};

const OUT_OF_CONTACT: &str = "tests/it/out_of_contact.rs";
const HISTORIES: &str = "crates/engine/tests/histories/main.rs";
const SENSE: &str = "tests/it/contact_sense.rs";
const EMERGENCY_STOP: &str = "tests/it/emergency_stop.rs";
const RUNS: &str = "tests/it/faults.rs";

/// Advice for a touch that gave no shift.
const REDO: &str = "nothing at once; `rigd redo RUN STEP` measures the touch again";

/// A touch that was refused, while the run goes on.
fn refused(refusal: &TouchRefusal) -> Seen {
    Seen { message: refusal.to_string(), advice: Some(REDO.to_owned()) }
}

fn sense(fault: ContactSenseFault) -> Seen {
    Seen::latched(&Fault::ContactSense(fault))
}

fn surface_moved() -> Seen {
    sense(ContactSenseFault::SurfaceMoved { found: at(9.412), by_mm: 0.588, limit_mm: 0.25 })
}

pub(super) const FAULTS: [ListedFault; 14] = [
    ListedFault {
        number: 17,
        class: Device,
        what: "the analyzer gives too few or too many values, or values that are no numbers",
        reaction: "asks up to three times, then safe; nothing of it is stored",
        seen: Some(|| Seen::latched(&Fault::MissingReadings { given: 2, asked: 3 })),
        tests: &[
            ("crates/analyzer/tests/it/measurements.rs", "no_single_fault_makes_a_reading_lie"),
            (HISTORIES, "whatever_goes_wrong_wherever_it_ends_clear_or_latched"),
        ],
    },
    ListedFault {
        number: 18,
        class: Device,
        what: "the analyzer is overloaded, or its signal is low",
        reaction: "measures the point up to three times and stores it with its flag; then refuses the \
                   touch, and the run goes on",
        seen: Some(|| {
            let reason =
                Reason::Flagged { flag: ReadingFlag::Overload, frequency_hz: 141.2, tries: 3 };
            refused(&TouchRefusal::Sweep(Box::new(Refusal { reason, estimate: None })))
        }),
        tests: &[
            (
                "tests/it/flags.rs",
                "a_touch_whose_readings_stay_flagged_is_refused_and_the_run_goes_on",
            ),
            (
                "tests/it/flags.rs",
                "a_flagged_reading_is_measured_again_and_one_that_stays_is_refused_by_name",
            ),
        ],
    },
    ListedFault {
        number: 19,
        class: Device,
        what: "the analyzer is switched off and on again",
        reaction: "notices its power-on flag, sets it up again and measures the point again, settled",
        seen: Some(|| analyzer(AnalyzerError::Restarted { port: analyzer_port() })),
        tests: &[(RUNS, "an_analyzer_that_restarts_or_falls_silent_spoils_no_reading")],
    },
    ListedFault {
        number: 20,
        class: Device,
        what: "another analyzer or drive than in the rig file",
        reaction: "refuses to start; nothing is set or moved",
        seen: Some(wrong_instrument),
        tests: &[
            (
                "crates/analyzer/tests/it/simulated.rs",
                "the_wrong_dialect_is_found_out_by_the_identity",
            ),
            ("crates/stage/tests/it/moves.rs", "a_device_that_is_no_drive_is_not_taken_for_one"),
        ],
    },
    ListedFault {
        number: 21,
        class: Device,
        what: "a drive has an alarm",
        reaction: "safe; an alarm of the linear drive is reset once, and one other alarm after it",
        seen: Some(|| linear(&alarmed(0x10, "excessive position deviation"))),
        tests: &[
            (OUT_OF_CONTACT, "an_alarm_of_the_linear_drive_is_reset_once_and_the_probe_gets_out"),
            (
                "crates/engine/tests/histories/out_of_contact.rs",
                "an_alarm_that_stays_is_reset_no_second_time_and_a_third_alarm_not_at_all",
            ),
        ],
    },
    ListedFault {
        number: 22,
        class: Device,
        what: "an axis halts on its way without an alarm",
        reaction: "the read-back is not the target: safe",
        seen: Some(|| {
            linear(&StageError::NotThere { wanted: at(30.0), at: at(17.43), off: 12.57 })
        }),
        tests: &[
            ("crates/stage/tests/it/moves.rs", "a_drive_that_does_not_move_as_told_is_found_out"),
            ("crates/stage/tests/it/simulated.rs", "what_befalls_a_drive_is_told"),
        ],
    },
    ListedFault {
        number: 23,
        class: Device,
        what: "an axis loses steps, and its read-back does not show it",
        reaction: "looks for the surface again after each sweep and refuses the touch if it has moved; a \
                   next surface too far from where it was, or the first one of a sample too low for the touch by the \
                   geometry of the rig file: safe, and the touch before on that sample is refused. A protocol \
                   with `slip_mm = 0` has no such check: each of its touches is marked as not checked for slip",
        seen: Some(surface_moved),
        tests: &[(SENSE, "lost_steps_refuse_the_touch_or_are_noticed_at_the_next_surface")],
    },
    ListedFault {
        number: 24,
        class: Device,
        what: "a drive loses its power, and perhaps its position",
        reaction: "identifies it again and retracts; a lost position is found only if the rig file says \
                   `homes = \"up\"`, or after a person has stated that nothing is below the probe; \
                   otherwise nothing moves. It is not moved either while it says that it is where its last moves \
                   cannot have led it",
        seen: Some(|| linear(&StageError::Unhomed { at: Position::new(0.0) })),
        tests: &[
            (
                OUT_OF_CONTACT,
                "a_linear_drive_that_restarts_is_identified_again_and_the_probe_gets_out",
            ),
            (
                OUT_OF_CONTACT,
                "a_drive_that_lost_its_position_is_homed_upwards_and_the_probe_gets_out",
            ),
            (
                OUT_OF_CONTACT,
                "a_drive_that_lost_its_position_is_not_moved_when_homing_may_lead_into_the_sample",
            ),
            (
                "tests/it/homing.rs",
                "a_drive_without_a_position_moves_only_after_a_person_has_looked_below_the_probe",
            ),
            (
                "crates/rigd/tests/safe.rs",
                "a_position_that_was_said_to_be_wrong_moves_no_probe_before_a_homing",
            ),
        ],
    },
    ListedFault {
        number: 25,
        class: Device,
        what: "a limit switch is reached",
        reaction: "as 21 where the drive has an alarm for it, as 22 otherwise",
        seen: Some(|| linear(&alarmed(0x66, "hardware overtravel"))),
        tests: &[(OUT_OF_CONTACT, "a_limit_switch_stops_the_linear_drive_and_the_probe_gets_out")],
    },
    ListedFault {
        number: 26,
        class: Device,
        what: "an emergency stop is pressed",
        reaction: "where the drive reports it (a flag of an IAI, alarm 0x68 of an AZ): latched at once. Its release \
                   moves nothing; after the acknowledgement the probe moves to its clear position before anything turns. A button that takes the power \
                   off the drives shows as 1 and then as 24, one that opens the enable input of a Leadshine as 22: \
                   the run ends, nothing is lowered or turned before a person acknowledges, and when the power is \
                   back, the probe may be retracted by itself. rigd is not a safety function",
        seen: Some(|| linear(&StageError::EmergencyStopped { at: at(9.812) })),
        tests: &[
            (
                EMERGENCY_STOP,
                "an_emergency_stop_that_a_flag_tells_latches_and_its_release_moves_nothing",
            ),
            (
                EMERGENCY_STOP,
                "an_emergency_stop_that_an_alarm_tells_latches_and_its_release_moves_nothing",
            ),
            (
                "crates/stage/tests/it/simulated.rs",
                "an_emergency_stop_is_told_and_its_release_moves_nothing",
            ),
        ],
    },
    ListedFault {
        number: 27,
        class: Device,
        what: "the input of an emergency stop is not connected",
        reaction: "nothing tells it before the button is needed: press it at an idle rig after each change of the \
                   wiring. A stop of page, terminal or HTTP needs no button and reaches both drives within 100 ms",
        seen: Some(|| Seen::latched(&Fault::Stopped { by: "Ada".to_owned() })),
        tests: &[("tests/it/stops.rs", "a_stop_reaches_both_drives_in_every_activity")],
    },
    ListedFault {
        number: 28,
        class: Device,
        what: "the contact sense is blind: no contact is felt",
        reaction: "the search ends at its floor, never deeper than a sample may be pressed: safe; a \
                   touch without a shift is refused",
        seen: Some(|| Seen::latched(&Fault::NoContact { at: at(9.5), expected: at(10.0) })),
        tests: &[
            (SENSE, "a_blind_contact_sense_leaves_no_wrong_shift"),
            (
                "crates/engine/src/search/tests.rs",
                "a_surface_beyond_the_range_is_a_fault_and_the_depth_stays_limited",
            ),
        ],
    },
    ListedFault {
        number: 29,
        class: Device,
        what: "the contact sense is stuck: contact is felt above the sample, or the readings are frozen",
        reaction: "tests the sense before each search: safe; the touch before is refused",
        seen: Some(|| {
            sense(ContactSenseFault::NotFree {
                frequency_hz: 141.2,
                percent: 64.0,
                limit_percent: 20.0,
            })
        }),
        tests: &[
            (SENSE, "a_stuck_contact_sense_leaves_no_wrong_shift"),
            (HISTORIES, "an_analyzer_that_repeats_its_last_reading_leaves_no_wrong_shift"),
        ],
    },
    ListedFault {
        number: 30,
        class: Device,
        what: "the sample swells, shifts or falls off",
        reaction: "finds the surface again at each touch; one that is too far from where the touches \
                   before expect it: safe; the touch before is refused",
        seen: Some(surface_moved),
        tests: &[
            (SENSE, "lost_steps_refuse_the_touch_or_are_noticed_at_the_next_surface"),
            (
                "crates/engine/src/search/tests.rs",
                "a_surface_beyond_the_range_is_a_fault_and_the_depth_stays_limited",
            ),
        ],
    },
];
