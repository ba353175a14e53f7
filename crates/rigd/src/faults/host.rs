//! Faults of the computer, its disk and its clock, of people and of networks.

use rig_engine::{CommandRefusal, Fault, RigState};
use rig_files::rig_file::RigFile;
use rig_model::with_causes;
use rig_store::{Flaw, Interruption, ProbeWord, StoreError};

use super::{
    FaultClass::{Host, Person},
    ListedFault, Seen,
};
use crate::{
    cli::SALVAGE,
    hint,
    http::FOREIGN_PAGE,
    interruption::{ADVICE, InterruptionView},
    rig::{CLOCK_WAS_SET, HELD_UP, RequestRefusal, unwritable},
};

const DISK: &str = "crates/rigd/tests/disk.rs";
const KILLS: &str = "crates/rigd/tests/resume/kills.rs";
const HOLD_UPS: &str = "crates/rigd/tests/hold_ups.rs";
const DAMAGE: &str = "crates/store/src/tests/damage.rs";
const FAILING_DISK: (&str, &str) =
    (DISK, "a_disk_that_fails_at_any_call_costs_no_committed_record_and_no_safety");

/// A journal that cannot be written.
fn journal(error: &StoreError) -> Seen {
    Seen::latched(&Fault::Device(unwritable(&with_causes(error))))
}

fn interrupted() -> Seen {
    let left = Interruption {
        at: "2026-11-22T14:03:07.120Z".to_owned(),
        step: Some("main/3/left/30/1".to_owned()),
        probe: ProbeWord::MayTouch { at_mm: Some(10.41), down_to_mm: Some(9.4) },
        is_cleared_since: false,
    };
    Seen { message: InterruptionView::from(left).message, advice: Some(ADVICE.to_owned()) }
}

pub(super) const FAULTS: [ListedFault; 10] = [
    ListedFault {
        number: 31,
        class: Host,
        what: "rigd panics or is killed",
        reaction: "a panic: safe, over a bus that is opened again. A kill: `rigd safe` retracts, if the \
                   service manager calls it; the next start latches until a person acknowledges, retracts \
                   first, and the run can be resumed",
        seen: Some(interrupted),
        tests: &[
            (
                "crates/rigd/src/rig/way_out/tests.rs",
                "a_panic_at_any_stage_of_a_run_ends_latched_with_a_clear_probe",
            ),
            (KILLS, "a_run_that_crashed_at_any_record_has_the_touches_of_one_that_did_not"),
            (KILLS, "a_program_that_is_killed_again_and_again_finishes_its_run"),
            ("crates/rigd/tests/safe.rs", "a_probe_in_contact_is_retracted_without_the_analyzer"),
        ],
    },
    ListedFault {
        number: 32,
        class: Host,
        what: "the program, the computer or its disk is held up",
        reaction: "notices more than a second, discards the readings of that time and measures them \
                   again; after four attempts safe. A rig loop that stands still alone is reported after \
                   5 s; a stop, a signal or 30 s replace rigd by `rigd safe`, with exit code 4",
        seen: Some(|| Seen::noted(HELD_UP)),
        tests: &[
            (
                HOLD_UPS,
                "ten_seconds_of_standstill_in_each_phase_of_a_touch_are_noticed_and_spoil_no_reading",
            ),
            (
                HOLD_UPS,
                "ten_seconds_of_a_write_in_each_phase_of_a_touch_are_noticed_and_spoil_no_reading",
            ),
            (
                "crates/engine/tests/histories/hold_up.rs",
                "a_host_that_is_held_up_again_and_again_ends_the_run_with_a_clear_probe",
            ),
            (
                "crates/rigd/tests/hangs.rs",
                "a_loop_that_stands_still_is_said_and_left_by_another_program",
            ),
        ],
    },
    ListedFault {
        number: 33,
        class: Host,
        what: "the power fails",
        reaction: "the intent to lower the probe is on disk before it is lowered; as a kill in 31",
        seen: Some(interrupted),
        tests: &[
            (KILLS, "a_run_that_crashed_at_any_record_has_the_touches_of_one_that_did_not"),
            (DAMAGE, "what_was_committed_survives_a_log_cut_at_any_length"),
        ],
    },
    ListedFault {
        number: 34,
        class: Host,
        what: "the disk is full",
        reaction: "refuses a run for which there is no room; during a run safe, and no committed record \
                   is lost",
        seen: Some(|| journal(&StoreError::DiskFull)),
        tests: &[
            (
                "crates/rigd/src/rig/space.rs",
                "a_run_is_refused_unless_twice_its_size_and_the_reserve_are_free",
            ),
            FAILING_DISK,
            (DAMAGE, "a_full_disk_closes_the_journal_and_keeps_what_was_committed"),
        ],
    },
    ListedFault {
        number: 35,
        class: Host,
        what: "the disk fails or becomes read-only",
        reaction: "safe; begins nothing without a journal; state and stop still work",
        seen: Some(|| journal(&StoreError::Closed)),
        tests: &[FAILING_DISK],
    },
    ListedFault {
        number: 36,
        class: Host,
        what: "a record is torn or damaged",
        reaction: "reads what its digests confirm, names the rest, and repairs nothing; \
                   `rigd salvage` copies it",
        seen: Some(|| {
            let message = format!("run smoke-7, record 212: {}", Flaw::Altered);
            Seen { message, advice: Some(SALVAGE.to_owned()) }
        }),
        tests: &[
            (DAMAGE, "a_flipped_bit_is_never_read_as_a_record"),
            (DAMAGE, "a_damaged_log_loses_its_tail_and_nothing_else"),
            (
                "crates/store/src/tests/salvage.rs",
                "a_damaged_run_does_not_hide_the_list_of_runs_nor_the_others",
            ),
        ],
    },
    ListedFault {
        number: 37,
        class: Host,
        what: "the wall clock jumps",
        reaction: "records it; nothing depends on the wall clock",
        seen: Some(|| Seen::noted(CLOCK_WAS_SET)),
        tests: &[(
            HOLD_UPS,
            "a_wall_clock_that_jumps_to_and_fro_changes_no_result_and_is_recorded",
        )],
    },
    ListedFault {
        number: 38,
        class: Person,
        what: "a protocol or rig file is wrong",
        reaction: "refuses it before anything moves, with every fault and its place",
        seen: Some(|| {
            let faults = RigFile::read("bench.toml", "label = \"bench\"\n");
            let text = faults.err().map(|faults| faults.to_string()).unwrap_or_default();
            let first = text.lines().next().unwrap_or_default();
            Seen { message: first.to_owned(), advice: Some("correct the file".to_owned()) }
        }),
        tests: &[(
            "crates/rigd/tests/cli.rs",
            "a_bad_protocol_is_refused_with_every_fault_and_its_place",
        )],
    },
    ListedFault {
        number: 39,
        class: Person,
        what: "two people, two windows, a double click, a repeated request",
        reaction: "one run at a time; a repeated `Idempotency-Key` begins no second run; anyone may stop",
        seen: Some(|| {
            let state = RigState::Running;
            let refusal = RequestRefusal::from(CommandRefusal::State { command: "run", state });
            Seen::refused(&refusal, hint::while_in(state))
        }),
        tests: &[
            ("tests/it/faults.rs", "of_many_starts_at_once_one_begins_a_run"),
            ("crates/rigd/tests/http.rs", "an_idempotency_key_is_known_after_a_restart"),
            ("crates/rigd/tests/page.rs", "a_late_answer_does_not_answer_the_next_prompt"),
        ],
    },
    ListedFault {
        number: 40,
        class: Person,
        what: "a browser closes, a network fails, a page of another site or a flood of requests comes",
        reaction: "the run goes on; the page says that the link is lost and catches up; other sites, \
                   large bodies and slow clients are refused; a stop gets through",
        seen: Some(|| Seen::noted(FOREIGN_PAGE)),
        tests: &[
            (
                "crates/rigd/tests/access.rs",
                "a_page_of_another_site_begins_nothing_and_reads_nothing",
            ),
            ("crates/rigd/tests/signals.rs", "a_stop_gets_through_when_every_connection_is_taken"),
            ("crates/rigd/src/http/server.rs", "a_head_that_drips_is_not_waited_for"),
        ],
    },
];
