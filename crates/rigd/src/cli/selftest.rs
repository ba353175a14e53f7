//! `rigd selftest`: checks a bench in levels, each with value, limit and advice, and an archive to send.

mod motion;

use std::{
    fs::File,
    io::{self, Write},
    path::PathBuf,
};

use clap::{Args, ValueEnum};

use super::{
    Failure,
    args::{BenchArgs, OutputArgs},
    commission::sensor::{FreeArgs, SensorOfSession},
    session::{LeftInContact, with_rig},
    table::{concluded, note, print, print_json},
};
use crate::{
    calibrations,
    doctor::Level,
    selftest::{Archive, Check, Depth, Quantity, Report, records, selftest},
};

#[derive(Debug, Args)]
pub(super) struct SelftestArgs {
    /// The last level; each one has those before it
    #[arg(long, value_enum, default_value_t = LevelArg::Electric)]
    level: LevelArg,
    /// File to write with the checks and the transcripts, to be sent; it must not exist. It has no names of
    /// persons, and serial numbers are hashes
    #[arg(long, value_name = "FILE")]
    archive: Option<PathBuf>,
    /// Hours of the level soak, from 1 to 24 [default: 8]
    #[arg(long, value_name = "H", value_parser = hours)]
    hours: Option<u32>,
    #[command(flatten)]
    free: FreeArgs,
    #[command(flatten)]
    bench: BenchArgs,
    #[command(flatten)]
    output: OutputArgs,
}

/// A level of the self-test.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, ValueEnum)]
enum LevelArg {
    /// The computer: permissions, names of adapters, programs that take ports
    Host,
    /// Each device, asked many times: times, late and corrupt answers
    Talk,
    /// The analyzer with the sensor or a capacitor: noise, and linearity with the level
    Electric,
    /// Both axes, with the probe clear and a bench in service, and the records of limits and homing
    Motion,
    /// The records of touches on a block, of the geometry and of the sensor
    Metrology,
    /// The free sensor for a night
    Soak,
}

/// A time that the soak does not take.
#[derive(Debug, thiserror::Error)]
#[error("the soak takes a whole number of hours, from 1 to 24")]
struct NoHours;

fn hours(text: &str) -> Result<u32, NoHours> {
    text.parse().ok().filter(|hours| (1..=24).contains(hours)).ok_or(NoHours)
}

/// Hours of a soak, if the person does not say.
const HOURS: u32 = 8;

pub(super) fn run(args: &SelftestArgs) -> Result<(), Failure> {
    if args.hours.is_some() && args.level != LevelArg::Soak {
        return Err(Failure::NoSoak);
    }
    let depth = match args.level {
        LevelArg::Host => Depth::Host,
        LevelArg::Talk => Depth::Talk,
        _ => Depth::Electric,
    };
    let archive_failed =
        |path: &PathBuf, source: io::Error| Failure::File { path: path.clone(), source };
    // Told before a night of measurements.
    if let Some(path) = args.archive.as_ref().filter(|path| path.exists()) {
        return Err(archive_failed(path, io::ErrorKind::AlreadyExists.into()));
    }
    let mut report = selftest(args.bench.rig.load()?, depth)?;
    if LevelArg::Motion <= args.level {
        in_service(args, &mut report)?;
    }
    let archive = Archive::of(&report);
    if let Some(path) = &args.archive {
        let failed = |source| archive_failed(path, source);
        let mut out = File::create_new(path).map_err(failed)?;
        let bytes = serde_json::to_vec_pretty(&archive).map_err(|error| failed(error.into()))?;
        out.write_all(&bytes).map_err(failed)?;
        note(&format!("wrote {}", path.display()));
    }
    let printed = if args.output.json {
        print_json(&archive.checks)
    } else {
        let printed = print(&report.checks.iter().map(line).collect::<Vec<_>>().join("\n"));
        let count = report.checks.len();
        let checks = if count == 1 { "check" } else { "checks" };
        note(&format!("{}: {count} {checks}", report.rig));
        printed
    };
    let problems = report.count(Level::Problem);
    concluded(printed, if problems > 0 { Err(Failure::Unfit { problems }) } else { Ok(()) })
}

/// The levels that need a bench in service. A bench that is not is a problem of the report.
fn in_service(args: &SelftestArgs, report: &mut Report) -> Result<(), Failure> {
    let (data, operator) = (args.bench.data.dir(), args.bench.operator.name());
    let rig = args.bench.rig.load()?;
    let (basis, limits) = (rig.basis(), rig.file.limits);
    let is_described = rig.is_put_together_as_described();
    let found = with_rig(rig, &data, &operator, LeftInContact::Refuse, async |session| {
        let mut checks = motion::moves(session, &limits).await?;
        if args.level == LevelArg::Soak {
            let check = args.free.check(60 * args.hours.unwrap_or(HOURS), &limits.analyzer)?;
            let night = check.watch(&mut SensorOfSession { session, data: &data }).await?;
            checks.extend(motion::soak(&night));
        }
        Ok(checks)
    });
    match found {
        Ok(checks) => report.checks.extend(checks),
        Err(failure @ (Failure::Interrupted | Failure::Aborted | Failure::Left { .. })) => {
            return Err(failure);
        }
        Err(failure) => {
            let advice = "`rigd doctor` says what is missing; a bench is in service after `rigd commission` and `rigd home`";
            report.checks.push(Check::problem(
                "bench",
                "in service",
                failure.to_string().replace('\n', "; "),
                advice,
            ));
        }
    }
    let records = calibrations::read(&data).map_err(super::commission::CommissionFailure::from)?;
    let now_s = jiff::Timestamp::now().as_second();
    // A simulated bench that is put together as described has no steps behind it.
    if !is_described {
        report.checks.extend(records::of_motion(&records, &basis, now_s));
    }
    if LevelArg::Metrology <= args.level {
        report.checks.extend(records::of_metrology(&records, &basis, now_s));
    }
    Ok(())
}

/// One line, with its advice below.
fn line(check: &Check) -> String {
    let Check { part, name, level, quantity, text, advice } = check;
    let measured = quantity.map(|Quantity { value, uncertainty, limit, unit }| {
        let uncertainty =
            uncertainty.map_or(String::new(), |sigma| format!(" ± {}", digits(sigma)));
        format!("{}{uncertainty} {unit}, limit {limit} {unit}", digits(value))
    });
    let seen = measured.or_else(|| text.clone()).unwrap_or_default();
    let advice = advice.map_or(String::new(), |advice| format!("\n{:7}  → {advice}", ""));
    format!("{:<7}  {part}, {name}: {seen}{advice}", level.name())
}

/// A number with three digits, and a count as it is.
fn digits(value: f64) -> String {
    if value == 0.0 || value.fract() == 0.0 {
        return value.to_string();
    }
    #[expect(clippy::cast_possible_truncation, reason = "a logarithm of a double is small")]
    let decimals = usize::try_from(2 - value.abs().log10().floor() as i32).unwrap_or(0);
    format!("{value:.decimals$}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_has_three_digits() {
        let rows =
            [(0.0, "0"), (3.0, "3"), (0.012_34, "0.0123"), (1.234_5, "1.23"), (1234.5, "1234")];
        for (value, expected) in rows {
            assert_eq!(digits(value), expected);
        }
    }
}
