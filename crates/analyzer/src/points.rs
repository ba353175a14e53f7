//! Measures one frequency after the other.

use std::time::Duration;

use rig_link::StopSignal;
use rig_model::{PointResult, Reading, SweepPoint};
use rig_scpi::{DataError, Datum};
use tokio::time::{Instant, sleep, sleep_until};

use crate::{
    Analyzer, AnalyzerError,
    dialect::PointCommands,
    hioki, lcr,
    message::Message,
    point::{Integration, TriggerSettings, mean},
    questions::shown,
};

/// During the search for the range, integration may take this multiple of the requested cycles.
const MEASURE_TIMES: f64 = 3.0;

/// Interval between queries for a measurement that is not ready.
const POLL: Duration = Duration::from_millis(20);

impl Analyzer {
    /// Measures one point; no reading when a stop was raised.
    pub(crate) async fn try_point(
        &mut self,
        commands: PointCommands,
        point: &SweepPoint,
        stop: &StopSignal,
    ) -> Result<Vec<Reading>, AnalyzerError> {
        self.set_up().await?;
        let frequency_hz = self.dialect.resolution.round(point.frequency_hz);
        let integration = commands.integration(point.cycles, frequency_hz);
        let delay_s = point.settle_s.min(self.dialect.delay_max_s);
        let mut wanted = TriggerSettings { frequency_hz, averages: integration.averages, delay_s };
        let rest_s = point.settle_s - delay_s;
        if 0.0 < rest_s && !self.settle(commands, &wanted, rest_s, stop).await? {
            return Ok(Vec::new());
        }
        let trigger_s = integration.cycles_per_trigger() / frequency_hz;
        let mut measured = Vec::new();
        let mut first = None;
        for _ in 0..integration.triggers {
            if stop.is_raised() {
                return Ok(Vec::new());
            }
            let (one, found_hz, asked_at) = self.trigger_once(commands, &wanted, trigger_s).await?;
            measured.push(one);
            first.get_or_insert((found_hz, asked_at));
            // The next trigger needs no settling.
            wanted.delay_s = 0.0;
        }
        let Some((found_hz, asked_at)) = first else { return Ok(Vec::new()) };
        let waited_s = asked_at.since(self.frequency_set_at).as_secs_f64();
        Ok(vec![Reading {
            frequency_hz: found_hz,
            measured: mean(&measured),
            started: self.frequency_set_at,
            settle_s: waited_s + delay_s,
            integration_s: f64::from(integration.triggers) * trigger_s,
        }])
    }

    /// Sets a shot and waits, for longer than the instrument itself can. `false` after a requested
    /// stop.
    async fn settle(
        &mut self,
        commands: PointCommands,
        wanted: &TriggerSettings,
        seconds: f64,
        stop: &StopSignal,
    ) -> Result<bool, AnalyzerError> {
        let before = self.current.take();
        let message = commands.settings(Message::new(), wanted, before.as_ref());
        self.confirm(message).await?;
        if before.is_none_or(|before| before.frequency_hz != wanted.frequency_hz) {
            self.frequency_set_at = self.port.link().clock().now();
        }
        self.current = Some(*wanted);
        tokio::select! {
            biased;
            () = stop.raised() => Ok(false),
            () = sleep(Duration::from_secs_f64(seconds)) => Ok(true),
        }
    }

    /// Sends the changed settings, triggers once, and confirms frequency and status.
    async fn trigger_once(
        &mut self,
        commands: PointCommands,
        wanted: &TriggerSettings,
        trigger_s: f64,
    ) -> Result<(PointResult, f64, rig_model::RigTime), AnalyzerError> {
        // Until it has confirmed, nothing is known about its settings.
        let before = self.current.take();
        let frequency_header = commands.frequency_header();
        let within = self.port.reply_within()
            + Duration::from_secs_f64(wanted.delay_s + MEASURE_TIMES * trigger_s);
        let begun = Instant::now();
        let (answers, asked_at, message) = self
            .ask_all(
                &[
                    &|m| commands.trigger(commands.settings(m, wanted, before.as_ref())),
                    &|m| m.query(frequency_header),
                    &|m| m.query("*ESR"),
                ],
                within,
            )
            .await?;
        let [reading, frequency, status] = &answers[..] else {
            unreachable!("three questions have three answers")
        };
        let status = self.read_status(&message, status.first())?;
        self.check(&message, status).await?;
        let found_hz = self.number(frequency_header, frequency)?;
        let tolerance_hz = self.dialect.resolution.tolerance_hz(wanted.frequency_hz);
        if (found_hz - wanted.frequency_hz).abs() > tolerance_hz {
            let (port, wanted) = (self.port.name(), wanted.frequency_hz);
            let what = "frequency in Hz";
            return Err(AnalyzerError::NotTaken { port, what, wanted, found: found_hz });
        }
        let measured = match commands.reading(reading) {
            Ok(Some(measured)) => measured,
            Ok(None) => {
                // Earlier it cannot be ready, and a line with echoes has better things to carry.
                sleep_until(begun + Duration::from_secs_f64(wanted.delay_s + trigger_s)).await;
                self.fetch_until(begun + within).await?
            }
            Err(_) => return Err(self.not_a_reading(&message, reading)),
        };
        if before.is_none_or(|before| before.frequency_hz != wanted.frequency_hz) {
            self.frequency_set_at = asked_at;
        }
        self.current = Some(*wanted);
        Ok((measured, found_hz, asked_at))
    }

    /// Asks again for a measurement that was not ready.
    async fn fetch_until(&mut self, deadline: Instant) -> Result<PointResult, AnalyzerError> {
        loop {
            sleep(POLL).await;
            let (answers, _, message) =
                self.ask_all(&[&|m| m.query(lcr::FETCH)], self.port.reply_within()).await?;
            match lcr::reading(&answers[0]) {
                Ok(Some(measured)) => return Ok(measured),
                Ok(None) if Instant::now() < deadline => {}
                _ => return Err(self.not_a_reading(&message, &answers[0])),
            }
        }
    }

    fn not_a_reading(&self, asked: &Message, data: &[Datum]) -> AnalyzerError {
        let found = shown(data);
        let expected = "resistance and reactance in ohm, and a status";
        self.port.unexpected(asked, expected, found.as_bytes())
    }
}

impl PointCommands {
    fn integration(self, cycles: u32, frequency_hz: f64) -> Integration {
        match self {
            Self::Hioki => hioki::integration(cycles),
            Self::Lcr(variant) => lcr::integration(cycles, frequency_hz, variant),
        }
    }

    fn settings(
        self,
        message: Message,
        wanted: &TriggerSettings,
        before: Option<&TriggerSettings>,
    ) -> Message {
        match self {
            Self::Hioki => hioki::settings(message, wanted, before),
            Self::Lcr(variant) => lcr::settings(message, wanted, before, variant),
        }
    }

    fn trigger(self, message: Message) -> Message {
        match self {
            Self::Hioki => hioki::trigger(message),
            Self::Lcr(_) => lcr::trigger(message),
        }
    }

    const fn frequency_header(self) -> &'static str {
        match self {
            Self::Hioki => hioki::FREQUENCY,
            Self::Lcr(_) => lcr::FREQUENCY,
        }
    }

    /// The result of a trigger; `None` while the measurement is under way.
    fn reading(self, data: &[Datum]) -> Result<Option<PointResult>, DataError> {
        match self {
            Self::Hioki => hioki::reading(data).map(Some),
            Self::Lcr(_) => lcr::reading(data),
        }
    }
}
