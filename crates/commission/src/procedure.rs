//! The steps themselves. Each is a short conversation with the bench; none writes or remembers anything.

mod geometry;
mod homing;
mod limits;
mod scale;
mod signs;
mod stop;
#[cfg(test)]
mod tests;

use rig_files::rig_file::RigFile;

use crate::{
    Answer, Asked, Bench, Choice, Finding, Jog, JogAxis, Jogged, NotDone, Order, Step,
    agreement::{Agreement, Progress},
};

/// The end of a step without a result, passed up with `?`.
enum Early<T> {
    /// The bench is gone.
    Trouble(T),
    /// The step has failed.
    Failed(String),
}

impl<T> From<T> for Early<T> {
    fn from(trouble: T) -> Self {
        Self::Trouble(trouble)
    }
}

/// Carries out a step of commissioning.
///
/// # Errors
/// The trouble of the bench. A step that fails is a finding.
pub async fn carry_out<B: Bench>(
    step: Step,
    rig: &RigFile,
    bench: &mut B,
) -> Result<Finding, B::Trouble> {
    let found = match step {
        Step::Stop => stop::carry_out(bench).await,
        Step::Signs => signs::carry_out(rig, bench).await,
        Step::Scale => scale::carry_out(rig, bench).await,
        Step::Geometry => geometry::carry_out(rig, bench).await,
        Step::Limits => limits::carry_out(rig, bench).await,
        Step::Homing => homing::carry_out(rig, bench).await,
    };
    match found {
        Ok(finding) => Ok(finding),
        Err(Early::Failed(why)) => Ok(Finding::failed(why)),
        Err(Early::Trouble(trouble)) => Err(trouble),
    }
}

/// Asks for a confirmation, without which the step fails.
async fn confirm<B: Bench>(bench: &mut B, asked: Asked) -> Result<(), Early<B::Trouble>> {
    match bench.ask(asked).await? {
        Answer::Choice(Choice::Yes) => Ok(()),
        _ => Err(Early::Failed(format!("not confirmed: {}", asked.text()))),
    }
}

/// Times that a person is asked to do something before the step fails.
const TIMES: usize = 5;

/// Asks again for what is not done yet. The step fails if it is not done at last.
async fn insist<B: Bench>(bench: &mut B, asked: Asked) -> Result<(), Early<B::Trouble>> {
    for _ in 1..TIMES {
        if bench.ask(asked).await? == Answer::Choice(Choice::Yes) {
            return Ok(());
        }
        bench.remark("Nothing moves before it is done.");
    }
    confirm(bench, asked).await
}

/// Makes a step of an axis. One that the drive does not make ends the step of commissioning.
async fn jog<B: Bench>(bench: &mut B, axis: JogAxis, by: f64) -> Result<Jogged, Early<B::Trouble>> {
    order(bench, Order::Step(Jog { axis, by })).await
}

/// Where an axis is. A drive that does not know it has lost its zero since the steps before: it ends the step of commissioning.
async fn located<B: Bench>(bench: &mut B, axis: JogAxis) -> Result<f64, Early<B::Trouble>> {
    let found = jog(bench, axis, 0.0).await?;
    if found.is_homed {
        return Ok(found.at);
    }
    Err(Early::Failed(format!(
        "{}: its drive says that it does not know where the axis is, and this step rests on that; `rigd commission changed zero` asks \
         again for the steps that rest on its zero, and the step geometry asks for the zero itself",
        axis.name()
    )))
}

/// Has a drive do something. One that does not ends the step of commissioning.
async fn order<B: Bench>(bench: &mut B, order: Order) -> Result<Jogged, Early<B::Trouble>> {
    attempt(bench, order).await?.map_err(|trouble| not_done(order, &trouble))
}

/// Has a drive try something that it may not do, and gives its reason then. An order that is refused was not tried: it ends the
/// step of commissioning.
async fn attempt<B: Bench>(
    bench: &mut B,
    order: Order,
) -> Result<Result<Jogged, String>, Early<B::Trouble>> {
    match bench.drive(order).await? {
        Ok(done) => Ok(Ok(done)),
        Err(NotDone::Failed(why)) => Ok(Err(why)),
        Err(NotDone::Refused(why)) => Err(not_done(order, &why)),
    }
}

fn not_done<T>(order: Order, why: &str) -> Early<T> {
    Early::Failed(format!("{}: {why}", order.axis().name()))
}

/// Brings an axis to a place, by steps that are admitted. Returns where it is.
async fn go_to<B: Bench>(
    bench: &mut B,
    axis: JogAxis,
    place: f64,
) -> Result<f64, Early<B::Trouble>> {
    let mut at = jog(bench, axis, 0.0).await?.at;
    while LEFT < (place - at).abs() {
        let by = (place - at).clamp(-axis.longest_step(), axis.longest_step());
        let next = jog(bench, axis, by).await?.at;
        let is_nearer = (next - place).abs() < (at - place).abs();
        if !is_nearer && (next - place).abs() <= NEAR {
            return Ok(next);
        }
        if !is_nearer {
            let (name, unit) = (axis.name(), axis.unit());
            return Err(Early::Failed(format!(
                "{name}: it stays at {next:.3} {unit} on its way to {place:.3} {unit}"
            )));
        }
        at = next;
    }
    Ok(at)
}

/// A way that is not gone, in units of the axis: the counts of a drive, and the jitter of its encoder.
const LEFT: f64 = 0.012;

/// As near as a drive comes whose counts are as long as the way that is left, and whose encoder jitters.
const NEAR: f64 = 0.03;

/// Asks for a reading until enough agree.
async fn agreed<B: Bench>(
    bench: &mut B,
    asked: Asked,
    mut agreement: Agreement,
) -> Result<f64, Early<B::Trouble>> {
    loop {
        let reading = reading(bench, asked).await?;
        match agreement.add(reading) {
            Progress::Settled(mean) => return Ok(mean.value),
            Progress::More { contradicts } => doubt(bench, contradicts),
            Progress::Failed => return Err(contradictory(asked)),
        }
    }
}

/// Asks for one reading.
async fn reading<B: Bench>(bench: &mut B, asked: Asked) -> Result<f64, Early<B::Trouble>> {
    match bench.ask(asked).await? {
        Answer::Reading(reading) => Ok(reading),
        Answer::Choice(choice) => Ok(choice.sense()),
    }
}

/// Says that a reading contradicts the others.
fn doubt<B: Bench>(bench: &mut B, contradicts: bool) {
    if contradicts {
        bench.remark("That contradicts the answers before it. Look again.");
    }
}

fn contradictory<T>(asked: Asked) -> Early<T> {
    Early::Failed(format!("the answers contradict each other: {}", asked.text()))
}
