//! The cost of a transaction on the host: `cargo bench -p rig-scpi`.
//!
//! Each row is the mean time of one repetition in the fastest of many short batches, so that other
//! load on the machine does not count. No port is involved: this is the time that the grammar adds
//! to the time on the wire.
#![expect(clippy::print_stdout, reason = "the numbers are the output of this program")]

use std::{
    hint::black_box,
    time::{Duration, Instant},
};

use rig_scpi::{
    Dialect, Ending, Framing, Instrument, Node, Program, RealFormat, ResponseDecoder, Tree, Value,
    query, setting,
};

const COMMANDS: &[Node<u8>] = &[
    setting("[:SOURce]:FREQuency[:CW]", 0),
    setting("[:SOURce]:VOLTage[:LEVel]", 1),
    setting(":FUNCtion:IMPedance[:TYPE]", 2),
    query(":FETCh[:IMPedance][:FORMatted]", 3),
    query(":CALCulate#:DATA:FDATa", 4),
];

fn main() {
    let tree = Tree::new(COMMANDS).expect("no two patterns match the same header");
    let new = || Instrument::new(tree.clone(), Dialect::standard("ACME,LCR,0,1"));

    report("power an instrument on", &mut || {
        black_box(new());
    });
    report("write FREQ 200.5 as a controller", &mut || {
        black_box(Program::command(":FREQ").number(200.5).finish(Ending::Lf).is_ok());
    });
    let mut instrument = new();
    report("carry out FREQ 200.5", &mut || {
        black_box(exchange(&mut instrument, b":FREQ 200.5\n"));
    });
    report("answer *IDN?", &mut || {
        black_box(exchange(&mut instrument, b"*IDN?\n"));
    });
    report("answer FETC? with three fields", &mut || {
        black_box(exchange(&mut instrument, b":FETC?\n"));
    });
    let answer = exchange(&mut instrument, b":FETC?\n");
    let mut decoder = ResponseDecoder::new(Framing::default());
    report("read that answer as a controller", &mut || {
        decoder.push(&answer);
        let response = decoder.poll().expect("a sound answer").expect("a whole answer");
        black_box(response.data().is_ok());
    });
    report("write, carry out, answer and read FETC?", &mut || {
        let program = Program::query(":FETC").finish(Ending::Lf).expect("a sound header");
        decoder.push(&exchange(&mut instrument, &program));
        let response = decoder.poll().expect("a sound answer").expect("a whole answer");
        black_box(response.data().is_ok());
    });
    let sweep = exchange(&mut instrument, b":CALC1:DATA:FDAT?\n");
    report("answer a sweep of 1601 points", &mut || {
        black_box(exchange(&mut instrument, b":CALC1:DATA:FDAT?\n"));
    });
    report("find the end of a sweep of 1601 points", &mut || {
        decoder.push(&sweep);
        black_box(decoder.poll().is_ok());
    });
    report("read a sweep of 1601 points", &mut || {
        decoder.push(&sweep);
        let response = decoder.poll().expect("a sound answer").expect("a whole answer");
        black_box(response.data().is_ok());
    });
}

fn exchange(instrument: &mut Instrument<u8>, bytes: &[u8]) -> Vec<u8> {
    const FORMAT: RealFormat =
        RealFormat::Scientific { n_decimals: 5, n_exponent: 2, has_plus: true };
    instrument.push(bytes);
    while let Some(call) = instrument.poll() {
        let reading = |value| Value::Formatted(value, FORMAT);
        instrument.answer(Ok(match call.command {
            3 => vec![reading(99.8765), reading(-1.2345), Value::Integer(0)],
            4 => (0..1601).flat_map(|i| [reading(f64::from(i) * 1.1), reading(0.0)]).collect(),
            _ => vec![],
        }));
    }
    instrument.take_output()
}

fn report(name: &str, run: &mut dyn FnMut()) {
    const BATCH: u32 = 32;
    let end = Instant::now() + Duration::from_millis(300);
    let mut fastest = Duration::MAX;
    while Instant::now() < end {
        let start = Instant::now();
        (0..BATCH).for_each(|_| run());
        fastest = fastest.min(start.elapsed());
    }
    let mean_us = fastest.as_secs_f64() * 1e6 / f64::from(BATCH);
    println!("{mean_us:>9.2} µs  {name}");
}
