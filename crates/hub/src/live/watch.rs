//! The side of a viewer.

use std::{collections::BTreeSet, str::FromStr, time::Duration};

use async_nats::Subscriber;
use futures_util::{
    StreamExt,
    stream::{SelectAll, select_all},
};
use rig_model::with_causes;
use serde::{Serialize, de::IgnoredAny};
use tokio::time::{Instant, timeout_at};

use super::{Broker, LiveError, Subjects, broker::Line, publish::REPEAT_EVERY, subject};
use crate::{BenchName, NameError};

/// A rig whose state does not come in this time is not there: two states in a row are missing.
const LISTEN: Duration = REPEAT_EVERY.saturating_mul(2).saturating_add(Duration::from_secs(1));

/// What a viewer wants to see.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Scope {
    /// All laboratories, which the hub itself may see.
    All,
    /// All benches of a laboratory.
    Lab(String),
    /// One bench.
    Bench(BenchName),
}

/// A message of a rig.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Heard {
    /// The bench.
    pub bench: BenchName,
    /// The kind of its record; none for a state.
    pub kind: Option<String>,
    /// The document, which is JSON.
    pub document: String,
}

/// Messages as they come.
#[derive(Debug)]
pub struct Watch {
    line: Line,
    messages: SelectAll<Subscriber>,
}

/// Which rigs are heard now.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct LiveState {
    /// Host and port of the nats-server.
    pub address: String,
    /// `LAB/NAME` of the benches whose state was heard, in order.
    pub heard: Vec<String>,
    /// Why none can be heard.
    pub error: Option<String>,
}

impl FromStr for Scope {
    type Err = NameError;

    fn from_str(text: &str) -> Result<Self, NameError> {
        if text.contains('/') {
            return text.parse().map(Self::Bench);
        }
        // A name of a bench has the rules of that of a laboratory.
        let BenchName { lab, .. } = format!("{text}/any").parse()?;
        Ok(Self::Lab(lab))
    }
}

impl Watch {
    /// Listens to states and events.
    ///
    /// # Errors
    /// [`LiveError`].
    pub async fn open(broker: &Broker, scope: &Scope) -> Result<Self, LiveError> {
        let line = broker.connect().await?;
        let subjects = match scope {
            Scope::All => ["state.>".to_owned(), "live.>".to_owned()],
            Scope::Lab(lab) => subject::all_of(lab),
            Scope::Bench(bench) => Subjects::of(bench).all(),
        };
        let mut all = Vec::new();
        for subject in subjects {
            all.push(line.client.subscribe(subject).await?);
        }
        Ok(Self { line, messages: select_all(all) })
    }

    /// The next message.
    ///
    /// # Errors
    /// [`LiveError`] if the connection ends or the server refuses.
    pub async fn next(&mut self) -> Result<Heard, LiveError> {
        loop {
            let message = tokio::select! {
                error = self.line.trouble() => return Err(error),
                Some(message) = self.messages.next() => message,
            };
            // Other programs may send what they like in their laboratory.
            let Some((bench, kind)) = subject::read(&message.subject) else { continue };
            let Ok(document) = String::from_utf8(message.payload.into()) else { continue };
            if serde_json::from_str::<IgnoredAny>(&document).is_err() {
                continue;
            }
            return Ok(Heard { bench, kind, document });
        }
    }
}

/// Listens until these benches are heard, or for 5 s.
pub async fn live_state(broker: &Broker, expected: &[String]) -> LiveState {
    let until = Instant::now() + LISTEN;
    let mut heard = BTreeSet::new();
    let listen = async {
        let mut watch = Watch::open(broker, &Scope::All).await?;
        while !expected.iter().all(|bench| heard.contains(bench)) {
            heard.insert(watch.next().await?.bench.to_string());
        }
        Ok::<_, LiveError>(())
    };
    let error = match timeout_at(until, listen).await {
        Ok(Err(error)) => Some(with_causes(&error)),
        // The time is over, and some were not heard.
        Ok(Ok(())) | Err(_) => None,
    };
    LiveState { address: broker.address().to_owned(), heard: heard.into_iter().collect(), error }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scope_is_a_laboratory_or_a_bench() {
        assert_eq!("lab".parse(), Ok(Scope::Lab("lab".to_owned())));
        assert_eq!("lab/left".parse(), Ok(Scope::Bench("lab/left".parse().unwrap())));
        for wrong in ["", ">", "lab/", "a b"] {
            assert!(wrong.parse::<Scope>().is_err(), "{wrong}");
        }
    }
}
