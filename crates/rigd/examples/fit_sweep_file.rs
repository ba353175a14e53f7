//! Reads a sweep from a CSV or Touchstone file and fits the resonance:
//! `cargo run -p rigd --example fit_sweep_file SWEEP`.
#![expect(clippy::print_stdout, reason = "the resonance is the output of this program")]

use std::{env, error::Error, fs};

use rig_files::sweep_file::SweepFile;
use rig_resonance::{FitOutcome, fit};

fn main() -> Result<(), Box<dyn Error>> {
    let path = env::args().nth(1).ok_or("usage: fit_sweep_file SWEEP")?;
    let text = SweepFile::decode(&fs::read(&path)?);
    // The third argument chooses one sweep of a file that numbers them.
    for sweep in SweepFile::read(&path, &text, None)?.sweeps {
        match fit(&sweep.readings, &sweep.fit_options()) {
            FitOutcome::Accepted(found) => {
                println!("resonance {:.3} Hz ± {:.3} Hz", found.resonance_hz, found.sigma_hz);
                println!("Q {:.1}, k_eff² {:.4}", found.q, found.k_eff_squared);
            }
            FitOutcome::Refused(refusal) => println!("no resonance: {refusal}"),
        }
    }
    Ok(())
}
