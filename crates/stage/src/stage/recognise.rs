//! Whether the device at an address is the drive that it should be, before anything moves.

use rig_model::{Span, Unit};

use super::Stage;
use crate::{
    AxisStatus, BusError, LineFault, Reply, Request, StageError,
    drive_reading::{number, read_request},
    line::CheckRegisters,
    order::{Order, limits_in},
};

/// Relative difference of two resolutions that are the same: a gear ratio is of two whole numbers, and a
/// rig file has some digits.
const RESOLUTION_REL: f64 = 1e-6;

/// What a drive shows without being written to.
#[derive(Debug, Clone, PartialEq)]
pub struct Look<U> {
    /// Its status.
    pub status: AxisStatus<U>,
    /// Whether its settings are those that [`Stage::identify`] gives it.
    pub has_settings: bool,
    /// The soft limits that it has, if it has some.
    pub soft: Option<Span<U>>,
}

impl<U: Unit> Stage<U> {
    /// Identifies the drive: checks its signature, writes and reads back its settings, makes it take
    /// commands from here, and reads its status. After each fault of the line, the settings identify
    /// it again. Nothing moves.
    ///
    /// # Errors
    /// [`StageError::Bus`] when it does not answer, refuses, or keeps other settings than it was
    /// given; [`StageError::Unrecognised`] when anything else may be there.
    pub async fn identify(&mut self) -> Result<AxisStatus<U>, StageError<U>> {
        let order = Order::at_rest(&self.scale, &self.axis)?;
        let settings = &self.map.settings;
        let request = read_request(settings.read);
        // A drive that was switched off has lost the settings that identified it.
        self.recognise_by(request.clone(), None).await?;
        self.check_signature().await?;
        let expected = Reply::Words(order.words(&settings.expect));
        // Those that are compared may be right, and others not written.
        if self.ask(request.clone()).await? != expected || self.are_settings_half {
            self.are_settings_half = true;
            self.take_all(&settings.write, &order).await?;
            self.are_settings_half = false;
            if self.ask(request.clone()).await? != expected {
                let (port, unit) = (self.bus.name().clone(), self.unit);
                let fault = LineFault::Changed { port, unit, request };
                return Err(BusError::from(fault).into());
            }
        }
        self.recognise_by(request, Some(expected)).await?;
        self.command(&self.map.prepare).await?;
        let status = self.status().await?;
        self.came_to_rest();
        Ok(status)
    }

    /// Recognises the drive and reads its status, and writes nothing: its settings are read and compared.
    /// It takes no moves after this that it would not have taken before.
    ///
    /// # Errors
    /// As [`identify`](Self::identify), except for settings, whose difference is in the [`Look`].
    pub async fn look(&mut self) -> Result<Look<U>, StageError<U>> {
        let request = read_request(self.map.settings.read);
        self.recognise_by(request, None).await?;
        self.look_again().await
    }

    /// The same look at a drive that was identified, and stays recognised by the settings that it was given.
    ///
    /// # Errors
    /// As [`look`](Self::look).
    pub async fn look_again(&mut self) -> Result<Look<U>, StageError<U>> {
        let order = Order::at_rest(&self.scale, &self.axis)?;
        let settings = &self.map.settings;
        self.check_signature().await?;
        let found = self.ask(read_request(settings.read)).await?;
        let has_settings = found == Reply::Words(order.words(&settings.expect));
        let soft = match &found {
            Reply::Words(words) => limits_in(&settings.expect, words),
            Reply::Bits(_) | Reply::Written => None,
        };
        let soft = soft.map(|(a, b)| {
            let [a, b] = [a, b].map(|counts| self.scale.position(counts.into()).value());
            Span::new(a.min(b), a.max(b))
        });
        Ok(Look { status: self.status().await?, has_settings, soft })
    }

    /// Checks, before anything is written, that the device is a drive of this make, and that it counts
    /// as the rig file says.
    async fn check_signature(&self) -> Result<(), StageError<U>> {
        let (signature, drives) = (&self.map.signature, self.map.drives.as_str());
        let reply = self.ask(read_request(signature.read)).await?;
        for &(address, width, min, max) in &signature.ranges {
            let (what, found) =
                (signature.what.as_str(), number(signature.read, &reply, address, width));
            if found < min || max < found {
                return Err(StageError::Unrecognised { what, found, min, max, drives });
            }
        }
        let Some(resolution) = self.map.resolution else { return Ok(()) };
        let read = |(address, width)| f64::from(number(signature.read, &reply, address, width));
        let found =
            resolution.factor * read(resolution.dividend) / resolution.divisor.map_or(1.0, read);
        let expected = self.scale.counts_per_revolution;
        // Ratios of settings of a drive need not be whole. One of two zeros is no number, and refused too.
        if (found - expected).abs() <= RESOLUTION_REL * expected {
            return Ok(());
        }
        Err(StageError::OtherResolution { found, expected })
    }

    async fn recognise_by(
        &self,
        request: Request,
        expected: Option<Reply>,
    ) -> Result<(), StageError<U>> {
        let registers = Some(CheckRegisters { request, expected });
        Ok(self.bus.set_check_registers(self.unit, registers).await?)
    }
}
