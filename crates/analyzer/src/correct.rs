//! Corrections of an analyzer for its cable and its fixture.

use std::time::Duration;

use rig_files::instrument::{
    dialect::{CableLength, Correction},
    template::Template,
};
use rig_scpi::Datum;

use crate::{Analyzer, AnalyzerError, message::Message, questions::shown};

/// Relative tolerance of a reported length.
const LENGTH_TOLERANCE_REL: f64 = 1e-6;

impl Analyzer {
    /// Sets the length of the cable, m, and reads it back.
    ///
    /// # Errors
    /// [`AnalyzerError::NotTaken`] when it reports another length, [`AnalyzerError::Refused`].
    pub async fn set_cable(
        &mut self,
        cable: &CableLength,
        length_m: f64,
    ) -> Result<(), AnalyzerError> {
        self.retry(async |this| {
            this.synchronise().await?;
            this.confirm(Message::new().template(&cable.set, |_| length_m)).await?;
            let (asked, data) = this.ask_one(&cable.ask).await?;
            let found = this.number(&asked, &data)?;
            if (found - length_m).abs() > LENGTH_TOLERANCE_REL * length_m.max(1.0) {
                let (port, what) = (this.port.name(), "length of the cable in m");
                return Err(AnalyzerError::NotTaken { port, what, wanted: length_m, found });
            }
            Ok(())
        })
        .await
    }

    /// Measures a correction, switches it on, and reads that it is on. What the correction is for must
    /// be between the terminals. The next measurement sets the instrument up again.
    ///
    /// # Errors
    /// [`AnalyzerError::NotTaken`] when the correction stays off, [`AnalyzerError::Refused`].
    pub async fn correct(&mut self, correction: &Correction) -> Result<(), AnalyzerError> {
        self.retry(async |this| {
            this.synchronise().await?;
            this.is_set_up = false;
            let within = this.port.reply_within() + Duration::from_secs_f64(correction.within_s);
            // The answer comes when the instrument has measured every frequency.
            let measure = |m: Message| m.plain(&correction.measure).query("*OPC");
            let ([_, status], _, asked) =
                this.ask_all(&[&measure, &|m| m.query("*ESR")], within).await?;
            let status = this.read_status(&asked, status.first())?;
            this.check(&asked, status).await?;
            this.confirm(Message::new().plain(&correction.switch_on)).await?;
            if this.asked_whether_on(&correction.state).await? {
                return Ok(());
            }
            let (port, what) = (this.port.name(), "state of the correction");
            Err(AnalyzerError::NotTaken { port, what, wanted: 1.0, found: 0.0 })
        })
        .await
    }

    /// Whether a correction is on.
    ///
    /// # Errors
    /// [`AnalyzerError::Refused`], and the error of an answer that does not say.
    pub async fn has_correction(&mut self, correction: &Correction) -> Result<bool, AnalyzerError> {
        self.retry(async |this| {
            this.synchronise().await?;
            this.asked_whether_on(&correction.state).await
        })
        .await
    }

    async fn asked_whether_on(&mut self, state: &Template) -> Result<bool, AnalyzerError> {
        let (asked, data) = self.ask_one(state).await?;
        match &data[..] {
            [Datum::Integer(0)] => Ok(false),
            [Datum::Integer(1)] => Ok(true),
            [Datum::Characters(word)] if word.eq_ignore_ascii_case("OFF") => Ok(false),
            [Datum::Characters(word)] if word.eq_ignore_ascii_case("ON") => Ok(true),
            _ => {
                let expected = "whether the correction is on: 1 or 0, ON or OFF";
                Err(self.port.unexpected(&asked, expected, shown(&data).as_bytes()))
            }
        }
    }

    async fn ask_one(
        &mut self,
        question: &Template,
    ) -> Result<(Message, Vec<Datum>), AnalyzerError> {
        let within = self.port.reply_within();
        let ([answer], _, asked) = self.ask_all(&[&|m| m.plain(question)], within).await?;
        Ok((asked, answer))
    }
}
