//! Any bytes and any host: pushes of any size, slow calls, device clears and operations in
//! progress, in any order and any dialect. Afterwards the instrument still answers.
#![no_main]

use libfuzzer_sys::fuzz_target;

#[path = "../../tests/meter/mod.rs"]
mod meter;

use meter::{Host, standard};
use rig_scpi::{AfterErrorPolicy, AfterQueryPolicy, Dialect, Ending, QUERY_ERRORS, Terminators, UnreadPolicy};

fuzz_target!(|input: (u8, Vec<(u8, &[u8])>)| {
    let (flags, steps) = input;
    let is = |bit: u8| flags & 1 << bit != 0;
    let mut host = Host::new(Dialect {
        terminators: if is(0) {
            Terminators::LineFeed
        } else {
            Terminators::LineFeedOrCarriageReturn
        },
        strings_span_lines: is(1),
        after_error: if is(2) { AfterErrorPolicy::Continue } else { AfterErrorPolicy::SkipMessage },
        after_query: if is(3) { AfterQueryPolicy::Continue } else { AfterQueryPolicy::Refuse },
        unread: if is(4) { UnreadPolicy::Keep } else { UnreadPolicy::Drop },
        query_errors: if is(5) { QUERY_ERRORS } else { &[] },
        headers: if is(6) { Some(true) } else { None },
        input_limit_bytes: if is(7) { 64 } else { 4096 },
        output_limit_bytes: 256,
        error_queue: Some(4),
        ending: Ending::Lf,
        ..standard()
    });
    for (action, bytes) in steps {
        host.instrument.push(bytes);
        match action % 8 {
            0 => host.instrument.device_clear(),
            1 => host.instrument.set_operation_pending(true),
            2 => host.instrument.set_operation_pending(false),
            3 => host.instrument.end_of_message(),
            4 => drop(host.instrument.fetch_output()),
            // A call that is under way while a clear comes.
            5 => {
                if host.instrument.poll().is_some() {
                    host.instrument.device_clear();
                    assert!(host.instrument.poll().is_none());
                    host.instrument.answer(Ok(vec![]));
                }
            }
            _ => host.run(),
        }
        assert!(host.instrument.room() <= host.instrument.dialect().input_limit_bytes);
    }
    host.instrument.set_operation_pending(false);
    host.run();
    host.instrument.device_clear();
    assert_eq!(host.say(b"*CLS\n*OPC?\n"), b"1\n");
});
