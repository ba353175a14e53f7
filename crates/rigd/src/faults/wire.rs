//! Faults of the line between computer and device.

use rig_analyzer::AnalyzerError;
use rig_link::Holder;
use rig_model::PortKind;
use rig_stage::{Exception, Symptom};

use super::{
    FaultClass::{Host, Wire},
    ListedFault, Seen,
    examples::{analyzer, analyzer_port, bus, linear, lost, no_answer, refusal, wrong_instrument},
};
use crate::{doctor::advice, rig::OpenError};

const LINES: &str = "crates/stage/tests/it/lines.rs";
const MOVES: &str = "crates/stage/tests/it/moves.rs";
const READINGS: &str = "crates/analyzer/tests/it/measurements.rs";
const ANY_FRAME: (&str, &str) = (LINES, "whatever_happens_to_a_frame_an_answer_is_the_truth");
const NO_LIE: (&str, &str) = (MOVES, "no_single_fault_makes_a_move_lie");
const NO_FALSE_READING: (&str, &str) = (READINGS, "no_single_fault_makes_a_reading_lie");

pub(super) const FAULTS: [ListedFault; 16] = [
    ListedFault {
        number: 1,
        class: Wire,
        what: "a request is lost",
        reaction: "asks up to three times, then safe",
        seen: Some(|| linear(&no_answer(Symptom::Silence, &[]))),
        tests: &[ANY_FRAME, NO_LIE],
    },
    ListedFault {
        number: 2,
        class: Wire,
        what: "a reply is lost, and its request was carried out",
        reaction: "as 1; every write is of absolute values and may be repeated",
        seen: Some(|| linear(&no_answer(Symptom::Silence, &[]))),
        tests: &[NO_LIE, (MOVES, "no_pair_of_faults_makes_a_move_lie")],
    },
    ListedFault {
        number: 3,
        class: Wire,
        what: "a reply comes late",
        reaction: "discards it: waits for silence and reads registers with known values before any \
                   other answer counts; then as 1",
        seen: Some(|| linear(&no_answer(Symptom::OtherAnswer, &[1, 3, 2, 0, 42, 0x38, 0x5B]))),
        tests: &[
            (LINES, "a_late_answer_is_taken_by_the_library_and_never_here"),
            (READINGS, "a_measurement_that_nobody_waited_for_is_not_taken_for_the_next"),
        ],
    },
    ListedFault {
        number: 4,
        class: Wire,
        what: "a reply comes twice",
        reaction: "discards the second one before the next request; then as 1",
        seen: Some(|| linear(&no_answer(Symptom::Surplus, &[1, 3, 2, 0, 42, 0x38, 0x5B]))),
        tests: &[ANY_FRAME],
    },
    ListedFault {
        number: 5,
        class: Wire,
        what: "a bit of a frame is wrong",
        reaction: "asks up to three times, then safe",
        seen: Some(|| linear(&no_answer(Symptom::Corrupted, &[1, 3, 2, 0, 43, 0x38, 0x5B]))),
        tests: &[ANY_FRAME, NO_FALSE_READING],
    },
    ListedFault {
        number: 6,
        class: Wire,
        what: "a reply is cut, or frames run together",
        reaction: "waits for silence, asks up to three times, then safe",
        seen: Some(|| linear(&no_answer(Symptom::Truncated, &[1, 3, 2]))),
        tests: &[ANY_FRAME, NO_FALSE_READING],
    },
    ListedFault {
        number: 7,
        class: Wire,
        what: "noise comes before a reply",
        reaction: "waits for silence, asks up to three times, then safe",
        seen: Some(|| linear(&no_answer(Symptom::Garbage, &[0xFF, 0, 0xFE]))),
        tests: &[ANY_FRAME, NO_FALSE_READING],
    },
    ListedFault {
        number: 8,
        class: Wire,
        what: "another unit answers",
        reaction: "discards it, asks up to three times, then safe",
        seen: Some(|| linear(&no_answer(Symptom::ForeignUnit(7), &[7, 3, 2, 0, 42, 0x7C, 0x5B]))),
        tests: &[ANY_FRAME],
    },
    ListedFault {
        number: 9,
        class: Wire,
        what: "a device is busy (exception 6), or needs long (exception 5)",
        reaction: "asks again for two seconds, then safe",
        seen: Some(|| linear(&refusal(Exception::Busy))),
        tests: &[(LINES, "a_busy_device_is_asked_again_until_it_is_free")],
    },
    ListedFault {
        number: 10,
        class: Wire,
        what: "a device refuses (exceptions 1 to 4)",
        reaction: "does not ask again; refuses to start, or safe",
        seen: Some(|| linear(&refusal(Exception::IllegalAddress))),
        tests: &[ANY_FRAME, NO_LIE],
    },
    ListedFault {
        number: 11,
        class: Wire,
        what: "speed or parity of a line is wrong",
        reaction: "refuses to start; nothing moves",
        seen: Some(|| {
            let error = no_answer(Symptom::Garbage, &[0xE0, 0x1C, 0xFC]);
            let source = Box::new(error.into());
            let error = OpenError::Device { role: "linear stage", kind: PortKind::Serial, source };
            Seen::refused(&error, advice::on_rig(&error))
        }),
        tests: &[(
            "crates/rigd/src/doctor/tests.rs",
            "a_device_that_does_not_answer_as_it_should_is_explained",
        )],
    },
    ListedFault {
        number: 12,
        class: Wire,
        what: "an adapter receives its own bytes",
        reaction: "takes the echo out; a dead device behind it is noticed",
        seen: Some(|| linear(&no_answer(Symptom::OnlyEcho, &[1, 3, 0, 0xCC, 0, 2, 4, 0x34]))),
        tests: &[(
            LINES,
            "an_adapter_that_echoes_is_lived_with_and_a_dead_device_behind_it_is_seen",
        )],
    },
    ListedFault {
        number: 13,
        class: Wire,
        what: "an adapter is unplugged",
        reaction: "closes the port at once; safe: opens it again by its name and identifies the \
                   drive, for as long as `patience_s` says",
        seen: Some(|| linear(&lost())),
        tests: &[
            (
                "tests/it/out_of_contact.rs",
                "a_bus_that_is_unplugged_for_a_while_is_opened_again_and_the_probe_gets_out",
            ),
            (
                "crates/link/tests/it/real.rs",
                "a_serial_port_is_opened_once_and_its_unplugging_is_seen",
            ),
        ],
    },
    ListedFault {
        number: 14,
        class: Host,
        what: "adapters are plugged in under other names, or swapped",
        reaction: "identifies each device before anything else; refuses to start, or safe",
        seen: Some(wrong_instrument),
        tests: &[
            ("crates/rigd/tests/ports.rs", "a_server_of_zeros_is_not_taken_for_a_drive"),
            (MOVES, "a_device_that_is_no_drive_is_not_taken_for_one"),
            (READINGS, "another_instrument_is_recognised"),
        ],
    },
    ListedFault {
        number: 15,
        class: Host,
        what: "another program has the port or the data directory",
        reaction: "refuses to start, and names the program",
        seen: Some(|| {
            let holders = vec![Holder { pid: 4711, name: "minicom".to_owned() }];
            let source = rig_link::OpenError::Busy { port: bus(), holders };
            let error = OpenError::Port { role: "bus", source };
            Seen::refused(&error, advice::on_rig(&error))
        }),
        tests: &[
            ("crates/link/tests/it/real.rs", "another_program_on_the_port_is_named"),
            (
                "crates/rigd/tests/safe.rs",
                "nothing_is_sent_while_another_program_has_the_data_directory_or_the_port",
            ),
            ("crates/store/src/tests/journal.rs", "a_directory_has_one_writer"),
        ],
    },
    ListedFault {
        number: 16,
        class: Wire,
        what: "the analyzer and rigd are at different messages after a timeout",
        reaction: "clears the line, makes sure that answers belong to their questions, and measures \
                   again; three times, then safe",
        seen: Some(|| analyzer(AnalyzerError::Strays { port: analyzer_port(), bytes: 24 })),
        tests: &[
            NO_FALSE_READING,
            (READINGS, "a_refusal_is_told_from_a_lost_answer_although_both_are_silent"),
        ],
    },
];
