//! The lease: where clients have tokens, one of them operates the rig and the others watch.
//!
//! The first command of a client with a named token takes a free lease. It ends when it is given back, when another client takes it over,
//! which the journal records, or ten minutes after the last command, unless a run is under way. A stop
//! needs no lease. Clients with a shared secret only claim their names: they hold no lease, and respect that
//! of another.

use std::{
    sync::{Mutex, MutexGuard, PoisonError},
    time::{Duration, SystemTime},
};

use axum::{
    Extension, Json,
    extract::State,
    http::{Method, StatusCode},
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tokio::time::Instant;

use super::{
    Problem, Shared,
    access::{self, Client},
    object::{Object, ObjectBody},
    progress::unix_ms,
};
use crate::{operator::Operator, rig_view::LeaseHolder, tokens::Role};

/// The lease ends this long after the last command of its holder.
const IDLE: Duration = Duration::from_secs(600);

/// Who operates the rig.
#[derive(Debug, Default)]
pub(super) struct Lease {
    holder: Mutex<Option<Holder>>,
}

#[derive(Debug, Clone)]
struct Holder {
    name: Operator,
    since: SystemTime,
    last: Instant,
}

impl Holder {
    fn is(&self, client: &Client) -> bool {
        client.is_named() && self.name == client.name
    }
}

/// What became of the lease.
#[derive(Debug, Clone, PartialEq, Eq)]
enum Taken {
    /// The client had it before.
    Kept,
    Free,
    From(Operator),
}

impl Lease {
    /// Its holder, while it lasts.
    fn holder(&self, is_running: bool) -> Option<Holder> {
        self.lasting(is_running).clone()
    }

    /// Takes the lease for a command, if nobody else has it. Of two first commands at once, one takes it.
    fn admit(&self, client: &Client, is_running: bool) -> Result<Taken, Holder> {
        let mut holder = self.lasting(is_running);
        match holder.as_ref().filter(|holder| !holder.is(client)) {
            Some(other) => Err(other.clone()),
            None => Ok(take_for(&mut holder, client)),
        }
    }

    /// Takes the lease, also from another holder.
    fn take(&self, client: &Client) -> Taken {
        take_for(&mut self.lock(), client)
    }

    /// The lock, after the end of a lease that is over.
    fn lasting(&self, is_running: bool) -> MutexGuard<'_, Option<Holder>> {
        let mut holder = self.lock();
        let is_over = |holder: &mut Holder| !is_running && holder.last.elapsed() >= IDLE;
        // One that is over has no holder.
        drop(holder.take_if(is_over));
        holder
    }

    fn lock(&self) -> MutexGuard<'_, Option<Holder>> {
        // Nothing that holds it panics.
        self.holder.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Makes a client the holder, if its token has a name.
fn take_for(holder: &mut Option<Holder>, client: &Client) -> Taken {
    let last = Instant::now();
    let taken = match holder {
        Some(holder) if holder.is(client) => {
            holder.last = last;
            return Taken::Kept;
        }
        Some(holder) => Taken::From(holder.name.clone()),
        None => Taken::Free,
    };
    let since = SystemTime::now();
    *holder = client.is_named().then(|| Holder { name: client.name.clone(), since, last });
    taken
}

impl Shared {
    /// Who operates the rig.
    pub(super) fn lease(&self) -> Option<LeaseHolder> {
        let holder = self.inner.lease.holder(self.is_running())?;
        Some(LeaseHolder { name: holder.name.to_string(), since_unix_ms: unix_ms(holder.since) })
    }

    /// Admits a command of a client, or refuses it because another client has the lease.
    pub(super) fn check_lease(&self, client: &Client) -> Result<(), Problem> {
        if !client.has_token {
            return Ok(());
        }
        let admitted = self.inner.lease.admit(client, self.is_running());
        admitted.map(drop).map_err(|holder| Problem::not_your_lease(holder.name.as_str()))
    }

    fn is_running(&self) -> bool {
        self.inner.rig.status().borrow().snapshot.progress.is_some()
    }
}

/// The lease as a client sees it.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct LeaseView {
    /// Who operates the rig; absent if nobody does.
    #[serde(skip_serializing_if = "Option::is_none")]
    holder: Option<LeaseHolder>,
    /// Whether it is the client itself.
    is_yours: bool,
}

/// A request for the lease.
#[derive(Debug, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct LeaseForm {
    /// Take it from another holder. The journal records it.
    #[serde(default)]
    take_over: bool,
}

pub(super) async fn show(
    State(shared): State<Shared>,
    Extension(client): Extension<Client>,
) -> Json<LeaseView> {
    let holder = shared.lease();
    let is_name = |holder: &LeaseHolder| holder.name == client.name.as_str();
    let is_yours = client.is_named() && holder.as_ref().is_some_and(is_name);
    Json(LeaseView { holder, is_yours })
}

pub(super) async fn take(
    State(shared): State<Shared>,
    Extension(client): Extension<Client>,
    form: ObjectBody<LeaseForm>,
) -> Result<Json<LeaseView>, Problem> {
    let Json(Object(LeaseForm { take_over })) = form?;
    let lease = &shared.inner.lease;
    if let Err(holder) = lease.admit(&client, shared.is_running()) {
        if !take_over {
            return Err(Problem::not_your_lease(holder.name.as_str()));
        }
        // On record before it counts.
        let action = format!("take over from {}", holder.name);
        shared.inner.rig.note(action, client.name.as_str()).await?;
        lease.take(&client);
    }
    Ok(show(State(shared), Extension(client)).await)
}

pub(super) async fn give_back(
    State(shared): State<Shared>,
    Extension(client): Extension<Client>,
) -> Result<StatusCode, Problem> {
    let holder = shared.inner.lease.holder(shared.is_running());
    if let Some(holder) = holder.filter(|holder| !holder.is(&client)) {
        if client.role < Role::Admin {
            return Err(Problem::not_your_lease(holder.name.as_str()));
        }
        let action = format!("end the lease of {}", holder.name);
        shared.inner.rig.note(action, client.name.as_str()).await?;
    }
    *shared.inner.lease.lock() = None;
    Ok(StatusCode::NO_CONTENT)
}

/// Whether a request leads the rig, so that it needs the lease.
pub(super) fn needs_lease(method: &Method, path: &str) -> bool {
    let leads = access::role_for(method, path) >= Role::Operate;
    leads && !path.starts_with("/api/v1/lease") && path != access::RELOAD
}

#[cfg(test)]
mod tests {
    use std::{sync::Barrier, thread};

    use super::*;

    #[tokio::test(start_paused = true)]
    async fn one_operates_until_the_lease_ends_and_another_takes_it_over() {
        let client = |name: &str, token: Option<&str>| {
            Client::of(name.parse().unwrap(), Role::Operate, token.map(str::to_owned))
        };
        let (ada, bob) = (client("ada", Some("1")), client("bob", Some("2")));
        let lease = Lease::default();
        assert_eq!(lease.admit(&ada, false).unwrap(), Taken::Free);
        assert_eq!(lease.admit(&bob, false).unwrap_err().name, ada.name);
        tokio::time::advance(IDLE / 2).await;
        assert_eq!(lease.admit(&ada, false).unwrap(), Taken::Kept);
        tokio::time::advance(IDLE / 2).await;
        assert!(lease.admit(&bob, false).is_err());
        tokio::time::advance(IDLE).await;
        assert!(lease.admit(&bob, true).is_err(), "a run is under way");
        assert_eq!(lease.admit(&bob, false).unwrap(), Taken::Free);
        assert_eq!(lease.take(&ada), Taken::From(bob.name.clone()));
        assert!(lease.admit(&bob, false).is_err());
        let claimed = client("ada", None);
        assert!(lease.admit(&claimed, false).is_err());
        assert_eq!(lease.take(&claimed), Taken::From(ada.name));
        assert_eq!(lease.admit(&claimed, false).unwrap(), Taken::Free);
        assert_eq!(lease.admit(&bob, false).unwrap(), Taken::Free);
    }

    #[test]
    fn of_many_first_commands_at_once_one_takes_the_lease() {
        for _ in 0..100 {
            let (lease, start) = (Lease::default(), Barrier::new(4));
            let is_admitted = |number: usize| {
                let (name, token) = (format!("client {number}"), Some(number.to_string()));
                let client = Client::of(name.parse().unwrap(), Role::Operate, token);
                start.wait();
                lease.admit(&client, false).is_ok()
            };
            let admitted = thread::scope(|scope| {
                let is_admitted = &is_admitted;
                let asked: Vec<_> =
                    (0..4).map(|number| scope.spawn(move || is_admitted(number))).collect();
                asked.into_iter().filter_map(|asked| asked.join().ok()).filter(|is| *is).count()
            });
            assert_eq!(admitted, 1);
        }
    }

    #[test]
    fn what_only_reads_or_stops_needs_no_lease() {
        for (method, path, is_needed) in [
            (Method::GET, "/api/v1/runs", false),
            (Method::POST, "/api/v1/stop", false),
            (Method::POST, "/api/v1/protocols/check", false),
            (Method::POST, "/api/v1/lease", false),
            (Method::DELETE, "/api/v1/lease", false),
            (Method::POST, "/api/v1/config/reload", false),
            (Method::POST, "/api/v1/runs", true),
            (Method::PUT, "/api/v1/runs/latest/note", true),
            (Method::POST, "/api/v1/acknowledge", true),
        ] {
            assert_eq!(needs_lease(&method, path), is_needed, "{method} {path}");
        }
    }
}
