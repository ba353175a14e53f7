//! Questions to an analyzer and their answers.

use std::time::Duration;

use rig_model::RigTime;
use rig_scpi::{Datum, ErrorReport, ExpectedResponse};

use crate::{Analyzer, AnalyzerError, EventStatus, instrument_port::TimedAnswer, message::Message};

/// More errors than this are not read out of an error queue.
const REPORTS_MAX: usize = 20;

/// Adds one or more units to a message; of these, one is a question.
pub(crate) type Question<'a> = &'a (dyn Fn(Message) -> Message + Sync);

impl Analyzer {
    /// Sends a message and asks for the event status behind it. The answer shows that the message
    /// was received.
    pub(crate) async fn confirm(&mut self, message: Message) -> Result<(), AnalyzerError> {
        let message = message.query("*ESR");
        let answer =
            self.port.ask(&message, ExpectedResponse::Data, self.port.reply_within()).await?;
        let status = self.read_status(&message, answer.response.datum().ok().as_ref())?;
        self.check(&message, status).await
    }

    /// Asks several questions, in one message where the instrument can take that. Returns the data
    /// of each answer, and when the first question had left the host.
    pub(crate) async fn ask_all<const N: usize>(
        &mut self,
        questions: &[Question<'_>; N],
        first_within: Duration,
    ) -> Result<([Vec<Datum>; N], RigTime, Message), AnalyzerError> {
        let all = questions.iter().fold(Message::new(), |message, ask| ask(message));
        if self.can_chain == Some(true) {
            let TimedAnswer { response, asked_at } =
                self.port.ask(&all, ExpectedResponse::Data, first_within).await?;
            let answers: Vec<Vec<Datum>> = match response.units() {
                Ok(units) => units.into_iter().map(|unit| unit.data).collect(),
                Err(_) => Vec::new(),
            };
            let Ok(answers) = answers.try_into() else {
                let expected = "an answer to each question";
                return Err(self.port.unexpected(&all, expected, response.bytes()));
            };
            return Ok((answers, asked_at, all));
        }
        let mut answers = [const { Vec::new() }; N];
        let mut first_asked_at = None;
        for (ask, answer) in questions.iter().zip(&mut answers) {
            let message = ask(Message::new());
            let is_first = first_asked_at.is_none();
            let within = if is_first { first_within } else { self.port.reply_within() };
            let TimedAnswer { response, asked_at } =
                self.port.ask(&message, ExpectedResponse::Data, within).await?;
            first_asked_at.get_or_insert(asked_at);
            let Ok(data) = response.data() else {
                return Err(self.port.unexpected(&message, "one answer", response.bytes()));
            };
            *answer = data;
        }
        Ok((answers, first_asked_at.unwrap_or_default(), all))
    }

    pub(crate) async fn event_status(&mut self) -> Result<EventStatus, AnalyzerError> {
        let message = Message::new().query("*ESR");
        let answer =
            self.port.ask(&message, ExpectedResponse::Data, self.port.reply_within()).await?;
        self.read_status(&message, answer.response.datum().ok().as_ref())
    }

    pub(crate) fn read_status(
        &self,
        asked: &Message,
        datum: Option<&Datum>,
    ) -> Result<EventStatus, AnalyzerError> {
        let status = datum.and_then(|datum| u8::try_from(datum.integer().ok()?).ok());
        status.map(EventStatus).ok_or_else(|| {
            let found = shown(datum);
            self.port.unexpected(asked, "an event status", found.as_bytes())
        })
    }

    /// Returns the error that the instrument reports.
    pub(crate) async fn check(
        &mut self,
        asked: &Message,
        status: EventStatus,
    ) -> Result<(), AnalyzerError> {
        if status.is_power_on() {
            return Err(AnalyzerError::Restarted { port: self.port.name() });
        }
        if status.is_error() {
            return Err(self.refused(asked.to_string().into(), status).await);
        }
        Ok(())
    }

    pub(crate) async fn refused(&mut self, asked: Box<str>, status: EventStatus) -> AnalyzerError {
        let mut reports = Vec::new();
        let question = Message::new().query(":SYSTem:ERRor");
        while self.dialect.transport.has_error_queue && reports.len() < REPORTS_MAX {
            let answer =
                self.port.ask(&question, ExpectedResponse::Data, self.port.reply_within()).await;
            match answer.map(|answer| ErrorReport::parse(&answer.response)) {
                Ok(Ok(Some(report))) => reports.push(report),
                _ => break,
            }
        }
        AnalyzerError::Refused { port: self.port.name(), asked, status, reports }
    }

    pub(crate) fn number(&self, asked: &Message, data: &[Datum]) -> Result<f64, AnalyzerError> {
        match data {
            [datum] if datum.number().is_ok() => Ok(datum.number().unwrap_or(f64::NAN)),
            _ => {
                let found = shown(data);
                Err(self.port.unexpected(asked, "a number", found.as_bytes()))
            }
        }
    }
}

/// Data about as the instrument wrote them.
pub(crate) fn shown<'a>(data: impl IntoIterator<Item = &'a Datum>) -> String {
    let one = |datum: &Datum| match datum {
        Datum::Integer(value) => value.to_string(),
        Datum::Real(value) => format!("{value:E}"),
        Datum::NonDecimal(value) => format!("#H{value:X}"),
        Datum::Text(text) => format!("\"{text}\""),
        Datum::Characters(word) => word.clone(),
        Datum::Block(bytes) => format!("a block of {} bytes", bytes.len()),
        Datum::Overload { is_negative } => {
            if *is_negative { "-9.9E37" } else { "9.9E37" }.to_owned()
        }
        Datum::Missing => "9.91E37".to_owned(),
    };
    data.into_iter().map(one).collect::<Vec<_>>().join(",")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_came_is_shown_as_it_was_written() {
        let data = [
            Datum::Integer(-3),
            Datum::Real(1.5e-7),
            Datum::Text("a".to_owned()),
            Datum::Characters("NEAR".to_owned()),
            Datum::Overload { is_negative: true },
            Datum::Missing,
            Datum::NonDecimal(255),
            Datum::Block(vec![1, 2]),
        ];
        let expected = "-3,1.5E-7,\"a\",NEAR,-9.9E37,9.91E37,#HFF,a block of 2 bytes";
        assert_eq!(shown(&data), expected);
        assert_eq!(shown(None), "");
    }
}
