//! The places of event streams: a number for all clients, and a part of them for each named token, so that no client
//! takes those of the others.

use std::{
    collections::HashMap,
    sync::{Arc, Mutex, MutexGuard, PoisonError},
};

use super::{Problem, access::Client};

/// The places that are taken.
#[derive(Debug)]
pub(super) struct Places {
    most: usize,
    /// The most of one named token.
    most_of_token: usize,
    taken: Mutex<Taken>,
}

#[derive(Debug, Default)]
struct Taken {
    all: usize,
    /// By fingerprint.
    of_token: HashMap<String, usize>,
}

/// A place, until it is dropped.
#[derive(Debug)]
pub(super) struct Place {
    places: Arc<Places>,
    token: Option<String>,
}

impl Places {
    pub(super) fn new(most: usize, most_of_token: usize) -> Arc<Self> {
        Arc::new(Self { most, most_of_token, taken: Mutex::default() })
    }

    /// Takes a place. Clients without a named token cannot be told apart, and share all of them.
    ///
    /// # Errors
    /// A problem that names the limit.
    pub(super) fn take(self: &Arc<Self>, client: &Client) -> Result<Place, Problem> {
        let mut taken = self.lock();
        if taken.all >= self.most {
            let most = self.most;
            return Err(Problem::busy(format!(
                "{most} event streams are open, which is the limit"
            )));
        }
        let token = client.token().map(str::to_owned);
        if let Some(token) = &token {
            let own = taken.of_token.entry(token.clone()).or_default();
            if *own >= self.most_of_token {
                let (name, most) = (&client.name, self.most_of_token);
                return Err(Problem::busy(format!(
                    "{most} event streams are open with the token {name}, which is the limit of one token"
                )));
            }
            *own += 1;
        }
        taken.all += 1;
        Ok(Place { places: Arc::clone(self), token })
    }

    /// Number of places that are taken.
    pub(super) fn taken(&self) -> usize {
        self.lock().all
    }

    /// The counts are complete even after a panic.
    fn lock(&self) -> MutexGuard<'_, Taken> {
        self.taken.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        let mut taken = self.places.lock();
        taken.all -= 1;
        let Some(token) = &self.token else { return };
        if let Some(own) = taken.of_token.get_mut(token) {
            *own -= 1;
            if *own == 0 {
                taken.of_token.remove(token);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tokens::Role;

    fn client(name: &str, token: Option<&str>) -> Client {
        Client::of(name.parse().unwrap(), Role::View, token.map(str::to_owned))
    }

    #[test]
    fn one_token_leaves_places_to_the_others_and_gets_its_own_back() {
        let places = Places::new(5, 2);
        let (ada, display) = (client("ada", Some("a")), client("display", Some("d")));
        let mut of_display: Vec<_> = (0..2).map(|_| places.take(&display).unwrap()).collect();
        assert!(places.take(&display).is_err(), "a third one of one token");
        let of_ada = places.take(&ada).unwrap();
        let nameless: Vec<_> =
            (0..2).map(|_| places.take(&client("cleo", None)).unwrap()).collect();
        assert!(places.take(&ada).is_err() && places.taken() == 5, "more than there are");
        drop(nameless);
        of_display.pop();
        assert!(places.take(&display).is_ok());
        drop((of_ada, of_display));
        assert_eq!(places.taken(), 0);
        assert!(places.lock().of_token.is_empty());
    }
}
