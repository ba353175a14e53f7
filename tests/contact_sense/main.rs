//! A contact sense that lies, and a stage that loses steps: how many touches have a wrong shift
//! without a warning, and how often the probe presses too deep.
//!
//! `cargo run -p rig-tests --release --bin contact-sense -- --seeds 50` breaks one device once in each
//! run, at a random moment, and compares every accepted shift with that of the undisturbed run of the
//! same seed. The last lines are the counts. The exit code is 0 only if no shift was wrong, nothing was
//! pressed too deep, and no undisturbed run had a refusal or a fault.

#![expect(clippy::print_stdout, reason = "what it prints is what it is for")]

use std::{collections::BTreeMap, process::ExitCode};

use clap::Parser;
use rand_core::Rng;
use rand_pcg::Pcg64;
use rig_engine::RunStatus;
use rig_store::Record;
use rig_tests::{TestRig, touches_of_smoke};

/// Judges what a run makes of a broken contact sense and of lost steps.
#[derive(Debug, Clone, Parser)]
struct Arguments {
    /// The first seed.
    #[arg(long, default_value_t = 1)]
    first_seed: u64,
    /// Number of seeds.
    #[arg(long, default_value_t = 20)]
    seeds: u64,
    /// Print every wrong shift.
    #[arg(long)]
    verbose: bool,
}

/// The ways in which a device is broken: on which port, and how.
const BROKEN: [(&str, &str); 11] = [
    ("analyzer", "stuck-contact"),
    ("analyzer", "blind-contact"),
    ("analyzer", "stuck-frequency"),
    ("bus", "lose-steps by=0.3 unit=1"),
    ("bus", "lose-steps by=-0.3 unit=1"),
    ("bus", "lose-steps by=0.15 unit=1"),
    ("bus", "lose-steps by=-0.15 unit=1"),
    ("bus", "lose-steps by=0.08 unit=1"),
    ("bus", "lose-steps by=-0.08 unit=1"),
    ("bus", "lose-steps by=0.04 unit=1"),
    ("bus", "lose-steps by=-0.04 unit=1"),
];

/// Messages to a port in a run of the protocol.
const MESSAGES: u64 = 350;

/// A shift may differ from that of the undisturbed run by this many standard deviations, or by this
/// part of it: noise and drift differ.
const SIGMAS: f64 = 6.0;
const SCATTER_REL: f64 = 0.03;

/// The end of a run.
struct End {
    status: RunStatus,
    /// Shift and its standard deviation by step, Hz.
    shifts: BTreeMap<String, (f64, f64)>,
    touches_refused: usize,
    cause: Option<String>,
    violations: Vec<String>,
}

#[derive(Debug, Default)]
struct Tally {
    runs: u32,
    wrong: u32,
    wrong_runs: u32,
    deep: u32,
    noticed: u32,
    right: u32,
}

#[tokio::main(flavor = "current_thread")]
async fn main() -> ExitCode {
    let arguments = Arguments::parse();
    let mut tallies: BTreeMap<&str, Tally> = BTreeMap::new();
    let (mut healthy, mut refused) = (0_u32, 0_u32);
    for seed in arguments.first_seed..arguments.first_seed + arguments.seeds {
        let sound = play(seed, None).await;
        healthy += 1;
        if sound.status != RunStatus::Completed {
            refused += 1;
            println!("seed {seed} undisturbed: {:?} {:?}", sound.status, sound.cause);
        }
        let mut draw = Pcg64::new(u128::from(seed), 0x5e45e);
        for (port, fault) in BROKEN {
            let nth = 1 + draw.next_u64() % MESSAGES;
            let end = play(seed, Some(&format!("fault {port} {fault} nth={nth}"))).await;
            let tally = tallies.entry(fault).or_default();
            tally.runs += 1;
            let before = tally.wrong;
            for (step, (hz, sigma_hz)) in &end.shifts {
                let Some((true_hz, true_sigma_hz)) = sound.shifts.get(step) else { continue };
                let allowed_hz =
                    (SIGMAS * sigma_hz.hypot(*true_sigma_hz)).max(SCATTER_REL * true_hz);
                if (hz - true_hz).abs() <= allowed_hz {
                    tally.right += 1;
                    continue;
                }
                tally.wrong += 1;
                if arguments.verbose {
                    println!(
                        "seed {seed} {fault} nth={nth} {step}: {hz:.2} Hz, truly {true_hz:.2} Hz; {:?}",
                        end.status
                    );
                }
            }
            tally.wrong_runs += u32::from(before < tally.wrong);
            if !end.violations.is_empty() {
                tally.deep += 1;
                if arguments.verbose {
                    println!("seed {seed} {fault} nth={nth}: {:?} {:?}", end.violations, end.cause);
                }
            }
            tally.noticed += u32::from(end.status == RunStatus::Faulted || end.touches_refused > 0);
        }
    }
    let mut is_clean = refused == 0;
    println!("{:28} {healthy} runs: {refused} with a refusal or a fault", "undisturbed");
    for (fault, tally) in &tallies {
        let Tally { runs, wrong, wrong_runs, deep, noticed, right } = tally;
        is_clean &= *wrong == 0 && *deep == 0;
        println!(
            "{fault:28} {runs} runs: {noticed} noticed, {right} shifts right, {wrong} wrong in \
             {wrong_runs} runs, {deep} pressed too deep"
        );
    }
    if is_clean { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

async fn play(seed: u64, fault: Option<&str>) -> End {
    let seed = format!("seed = {seed}");
    let rig = TestRig::open_bench(&[], &[("seed = 2020", &seed)]).await;
    if let Some(fault) = fault {
        rig.fault(fault);
    }
    let protocol = touches_of_smoke("[0, 15, 30, 45]");
    let (run, status) = rig.run(rig.protocol(&protocol)).await;
    let mut end = End {
        status,
        shifts: BTreeMap::new(),
        touches_refused: 0,
        cause: None,
        violations: Vec::new(),
    };
    for stored in rig.records(run) {
        match stored.record() {
            Ok(Record::TouchResult(touch)) => {
                let step = format!("{:?}", touch.touch);
                end.shifts.insert(step, (touch.shift_hz, touch.shift_sigma_hz));
            }
            // What was measured next may contradict a touch.
            Ok(Record::TouchRefused(refused)) => {
                end.shifts.remove(&format!("{:?}", refused.touch));
                end.touches_refused += 1;
            }
            Ok(Record::Fault(fault)) => end.cause = end.cause.or(Some(fault.cause)),
            _ => {}
        }
    }
    let now = rig.handle.status().borrow().now;
    let simulation = rig.handle.simulation().expect("the rig is simulated");
    end.violations = simulation.with(|_, rig| {
        rig.world()
            .violations(now)
            .iter()
            .map(|violation| format!("{:?}", violation.kind))
            .collect()
    });
    rig.close().await;
    end
}
