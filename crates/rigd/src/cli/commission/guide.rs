//! The bench as `rigd commission` sees it: the person at the terminal, or the simulated one, and the rig.

use std::{collections::VecDeque, path::PathBuf, sync::Arc};

use rig_commission::{Answer, Asked, Basis, Bench, Choice, Jog, JogAxis, Jogged, NotDone, Order};
use rig_engine::Command;

use super::CommissionFailure;
use crate::{
    calibrations::{self, Witness},
    cli::{
        Failure,
        prompt::{NoLine, Terminal},
        screen::{indented, say, say_clearly},
        signals::Signals,
    },
    operator::Operator,
    rig::{NotMade, RequestRefusal, RigHandle},
};

/// The name in the record of a step that the simulated person has answered.
const SIMULATED_PERSON: &str = "simulated person";

/// What is not answered by `--yes`.
const HOMING: &str = "whether a drive may find its zero, which `--yes` does not answer";

/// What its records rest on, and where they are.
pub(super) struct Records {
    pub(super) basis: Basis,
    pub(super) data: PathBuf,
    /// Temperature at the bench, °C, if it was told.
    pub(super) temperature_c: Option<f64>,
}

/// A bench in the middle of a step.
pub(super) struct Guide {
    handle: RigHandle,
    operator: Operator,
    pub(super) records: Records,
    signals: Signals,
    terminal: Terminal,
    /// Answers from the command line, in their order.
    given: VecDeque<String>,
    /// Steps of the axes need no Enter. A homing needs an answer all the same.
    is_confirmed: bool,
    /// The simulated person has answered.
    is_simulated: bool,
}

impl Guide {
    pub(super) fn new(
        handle: RigHandle,
        operator: Operator,
        signals: Signals,
        records: Records,
        (is_confirmed, given): (bool, &[String]),
    ) -> Result<Self, Failure> {
        let terminal =
            Terminal::open().map_err(|source| Failure::System { what: "terminal", source })?;
        let given = given.iter().cloned().collect();
        let is_simulated = false;
        Ok(Self { handle, operator, records, signals, terminal, given, is_confirmed, is_simulated })
    }

    /// One step of one axis.
    pub(super) async fn single(&mut self, jog: Jog) -> Result<(), Failure> {
        // A simulated person sees that nothing is below the probe.
        self.is_simulated = self.handle.ask_simulated(Asked::NoSample).await?.is_some();
        let axis = jog.axis.name();
        let made = self.order(Order::Step(jog)).await?;
        made.map_err(|trouble| CommissionFailure::NoStep { axis, trouble })?;
        Ok(())
    }

    /// Has a drive do something, once the person lets it.
    async fn order(&mut self, order: Order) -> Result<Result<Jogged, NotMade>, Failure> {
        let (axis, unit) = (order.axis().name(), order.axis().unit());
        if order.is_homing() && !self.is_simulated {
            self.let_home(order).await?;
        } else if order.may_move() && !self.is_confirmed && !self.is_simulated {
            self.line("whether the axis may move", format!("Press Enter: {order}")).await?;
        }
        let (handle, operator) = (self.handle.clone(), self.operator.clone());
        let step = handle.drive(order, operator.as_str());
        tokio::pin!(step);
        let jogged = tokio::select! {
            // First, so that no motion follows the stop.
            biased;
            ended = &mut step => ended?,
            () = self.signals.next() => {
                handle.command(Command::Stop, None, operator.as_str()).await?;
                _ = step.await;
                return Err(Failure::Interrupted);
            }
        };
        match &jogged {
            Ok(Jogged { from, at, .. }) if from != at => {
                say(&format!("{axis}: {from:.3} {unit} → {at:.3} {unit}"));
            }
            Ok(_) => {}
            Err(trouble) => say_clearly(&indented(&format!("{axis}: {trouble}"), 0)),
        }
        Ok(jogged)
    }

    /// Asks whether a drive may find its zero: what was said of the bench before says nothing of that way.
    async fn let_home(&mut self, order: Order) -> Result<(), Failure> {
        let text = format!("When you answer yes: {order} May it?");
        let asked = Asked::NoSample;
        let answer = if let Some(given) = self.given.pop_front() {
            asked.read(&given).map_err(CommissionFailure::from)?
        } else {
            loop {
                let line = self.line(HOMING, format!("{text} [{}]", asked.expected())).await?;
                match asked.read(&line) {
                    Ok(answer) => break answer,
                    Err(error) => say_clearly(&error.to_string()),
                }
            }
        };
        if answer == Answer::Choice(Choice::Yes) {
            return Ok(());
        }
        Err(CommissionFailure::NotLet { axis: order.axis().name() }.into())
    }

    /// Who answered.
    fn person(&self) -> String {
        let person = if self.is_simulated { SIMULATED_PERSON } else { self.operator.as_str() };
        person.to_owned()
    }

    /// Who sees it, and in which session of the journal.
    pub(super) fn witness(&self) -> Witness {
        Witness {
            person: self.person(),
            journal: vec![self.handle.status().borrow().session.to_string()],
            temperature_c: self.records.temperature_c,
        }
    }

    /// Has the rig see what has been shown, and returns what is missing.
    pub(super) async fn read_calibrations(&self) -> Result<Option<Arc<str>>, RequestRefusal> {
        self.handle.read_calibrations(self.operator.as_str()).await
    }

    /// After a homing that was interrupted, what rests on the zero of a drive is no longer shown.
    pub(super) async fn void_after_interrupted_homing(&self) -> Result<(), Failure> {
        let Records { basis, data, .. } = &self.records;
        let voided = calibrations::void_after_interrupted_homing(basis, data, &self.witness());
        if voided.map_err(CommissionFailure::from)? {
            say_clearly(&indented(calibrations::HOMING_WAS_INTERRUPTED, 0));
            self.read_calibrations().await?;
        }
        Ok(())
    }

    pub(super) async fn close(&self) {
        self.handle.close().await;
    }

    /// Reads a line at the terminal.
    async fn line(&mut self, question: &'static str, prompt: String) -> Result<String, Failure> {
        self.terminal.show(Some(indented(&prompt, 0)));
        let line = tokio::select! {
            line = self.terminal.answer() => line.map_err(|why| match why {
                NoLine::Ended => CommissionFailure::Unanswered { question }.into(),
                NoLine::Unread(source) => CommissionFailure::Unread { question, source }.into(),
            }),
            () = self.signals.next() => Err(Failure::Interrupted),
        };
        self.terminal.show(None);
        line
    }
}

impl Bench for Guide {
    type Trouble = Failure;

    async fn ask(&mut self, asked: Asked) -> Result<Answer, Failure> {
        let text = asked.text();
        if let Some(answer) = self.handle.ask_simulated(asked).await? {
            self.is_simulated = true;
            say(&indented(&format!("{text} {SIMULATED_PERSON}: {answer}"), 0));
            return Ok(answer);
        }
        if let Some(given) = self.given.pop_front() {
            let answer = asked.read(&given).map_err(CommissionFailure::from)?;
            say(&indented(&format!("{text} {answer}"), 0));
            self.handle.answered(asked, answer).await?;
            return Ok(answer);
        }
        loop {
            let line = self.line(text, format!("{text} [{}]", asked.expected())).await?;
            match asked.read(&line) {
                Ok(answer) => {
                    self.handle.answered(asked, answer).await?;
                    return Ok(answer);
                }
                Err(error) => say_clearly(&error.to_string()),
            }
        }
    }

    async fn drive(&mut self, order: Order) -> Result<Result<Jogged, NotDone>, Failure> {
        Ok(self.order(order).await?.map_err(NotDone::from))
    }

    async fn seen(&mut self, axis: JogAxis) -> Result<(), Failure> {
        Ok(self.handle.step_seen(axis, self.operator.as_str()).await?)
    }

    async fn homing_begins(&mut self) -> Result<(), Failure> {
        let Records { basis, data, .. } = &self.records;
        let begun = calibrations::begin_homing(basis, data, self.witness());
        Ok(begun.map_err(CommissionFailure::from)?)
    }

    fn remark(&mut self, text: &str) {
        say_clearly(text);
    }
}
