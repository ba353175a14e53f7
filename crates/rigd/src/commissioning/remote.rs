//! The bench as a step of commissioning sees it through clients, or through the simulated person.

use rig_commission::{Answer, Asked, Bench, Choice, JogAxis, Jogged, NotDone, Order};
use rig_engine::Command;
use tokio_util::sync::CancellationToken;

use super::{Commissioning, Ended};

/// The name in the record of a step that the simulated person has answered.
pub(crate) const SIMULATED_PERSON: &str = "simulated person";

/// What a client is asked.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Question {
    /// What a person does or sees.
    Asked(Asked),
    /// Whether a drive may do this.
    Drive(Order),
}

impl Question {
    /// What answers it.
    pub(crate) const fn asked(self) -> Asked {
        match self {
            Self::Asked(asked) => asked,
            Self::Drive(_) => Asked::NoSample,
        }
    }

    /// The question for a person.
    pub(crate) fn text(self) -> String {
        match self {
            Self::Asked(asked) => asked.text().to_owned(),
            Self::Drive(order) => format!("When you answer yes: {order} May it?"),
        }
    }
}

/// A bench in the middle of a step.
pub(super) struct Remote {
    commissioning: Commissioning,
    /// Who answered last; before the first answer, who began the commissioning.
    by: String,
    /// Who answered in this step, each once, in the order of their first answers.
    answered: Vec<String>,
    stop: CancellationToken,
    temperature_c: Option<f64>,
    is_simulated: bool,
}

impl Remote {
    pub(super) const fn new(
        commissioning: Commissioning,
        by: String,
        stop: CancellationToken,
        temperature_c: Option<f64>,
    ) -> Self {
        let answered = Vec::new();
        Self { commissioning, by, answered, stop, temperature_c, is_simulated: false }
    }

    /// Who answered last; before the first answer, who began the commissioning.
    pub(super) fn into_by(self) -> String {
        self.by
    }

    /// Who answered in this step; several names have commas between them, which no name has. A step without an answer has
    /// the name of who answered last before it, or of who began the commissioning.
    pub(super) fn person(&self) -> String {
        if self.is_simulated {
            SIMULATED_PERSON.to_owned()
        } else if self.answered.is_empty() {
            self.by.clone()
        } else {
            self.answered.join(", ")
        }
    }

    fn say(&self, text: String) {
        self.commissioning.progress().say(text);
    }

    /// Waits for the answer of a client, and remembers who gave it.
    async fn answer(&mut self, question: Question) -> Result<Answer, Ended> {
        let answered = self.commissioning.progress().ask(question);
        let (answer, by) = tokio::select! {
            answered = answered => answered.map_err(|_| Ended::Aborted)?,
            () = self.stop.cancelled() => return Err(Ended::Aborted),
        };
        if !self.answered.contains(&by) {
            self.answered.push(by.clone());
        }
        self.by = by;
        Ok(answer)
    }
}

impl Bench for Remote {
    type Trouble = Ended;

    async fn ask(&mut self, asked: Asked) -> Result<Answer, Ended> {
        if self.stop.is_cancelled() {
            return Err(Ended::Aborted);
        }
        if let Some(answer) = self.commissioning.rig.ask_simulated(asked).await? {
            self.is_simulated = true;
            self.say(format!("{} {SIMULATED_PERSON}: {answer}", asked.text()));
            return Ok(answer);
        }
        let answer = self.answer(Question::Asked(asked)).await?;
        self.commissioning.rig.answered(asked, answer).await?;
        Ok(answer)
    }

    async fn drive(&mut self, order: Order) -> Result<Result<Jogged, NotDone>, Ended> {
        if order.may_move() && !self.is_simulated {
            let answer = self.answer(Question::Drive(order)).await?;
            if answer != Answer::Choice(Choice::Yes) {
                return Err(Ended::NotLet);
            }
        }
        if self.stop.is_cancelled() {
            return Err(Ended::Aborted);
        }
        let rig = self.commissioning.rig.clone();
        let step = rig.drive(order, &self.by);
        tokio::pin!(step);
        let jogged = tokio::select! {
            // First, so that no motion follows the stop.
            biased;
            ended = &mut step => ended?,
            () = self.stop.cancelled() => {
                let by = self.commissioning.progress().aborted_by.clone();
                rig.command(Command::Stop, None, by.as_deref().unwrap_or(&self.by)).await?;
                _ = step.await;
                return Err(Ended::Aborted);
            }
        };
        let (axis, unit) = (order.axis().name(), order.axis().unit());
        match &jogged {
            Ok(Jogged { from, at, .. }) if from != at => {
                self.say(format!("{axis}: {from:.3} {unit} → {at:.3} {unit}"));
            }
            Ok(_) => {}
            Err(trouble) => self.say(format!("{axis}: {trouble}")),
        }
        Ok(jogged.map_err(NotDone::from))
    }

    async fn seen(&mut self, axis: JogAxis) -> Result<(), Ended> {
        Ok(self.commissioning.rig.step_seen(axis, &self.by).await?)
    }

    async fn homing_begins(&mut self) -> Result<(), Ended> {
        let begun = self.commissioning.begin_homing(self.person(), self.temperature_c);
        Ok(begun.await.map_err(Box::new)?)
    }

    fn remark(&mut self, text: &str) {
        self.say(text.to_owned());
    }
}
