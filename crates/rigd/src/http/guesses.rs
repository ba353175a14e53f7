//! How many wrong tokens an address may send.
//!
//! Tokens that rigd has made have 256 random bits and cannot be guessed; the secret in the file of
//! `--token-file` is chosen by a person. An address that has sent too many wrong ones is not compared with
//! that secret for a while, unless it has given the right one before: a broken script must not shut out the
//! person beside it.

use std::{
    collections::BTreeMap,
    net::{IpAddr, Ipv6Addr},
    sync::{Mutex, PoisonError},
    time::Duration,
};

use tokio::time::Instant;

/// Wrong tokens in a row without a pause.
const BURST: u32 = 10;
/// Time after which one more is allowed.
pub(super) const PAUSE: Duration = Duration::from_secs(6);
/// Addresses that are remembered.
const ADDRESSES_MAX: usize = 1024;

/// The wrong tokens by address.
#[derive(Debug, Default)]
pub(super) struct Guesses {
    by_address: Mutex<BTreeMap<IpAddr, Account>>,
}

#[derive(Debug, Clone, Copy)]
struct Account {
    wrong: u32,
    /// When the oldest wrong one is forgotten.
    since: Instant,
    has_been_right: bool,
}

impl Account {
    fn forget(&mut self, now: Instant) {
        while self.wrong > 0 && now.saturating_duration_since(self.since) >= PAUSE {
            self.wrong -= 1;
            self.since += PAUSE;
        }
    }
}

impl Guesses {
    /// Whether an address may try another secret.
    pub(super) fn may_try(&self, address: Option<IpAddr>) -> bool {
        self.account(address, |account| account.has_been_right || account.wrong < BURST)
    }

    /// Counts a wrong token; `false` when there are too many now.
    pub(super) fn was_wrong(&self, address: Option<IpAddr>) -> bool {
        self.account(address, |account| {
            if account.wrong == 0 {
                account.since = Instant::now();
            }
            account.wrong = (account.wrong + 1).min(BURST + 1);
            account.wrong <= BURST
        })
    }

    /// The address knows the secret of the token file.
    pub(super) fn was_right(&self, address: Option<IpAddr>) {
        self.account(address, |account| account.has_been_right = true);
    }

    fn account<T>(&self, address: Option<IpAddr>, work: impl FnOnce(&mut Account) -> T) -> T {
        let now = Instant::now();
        // Nothing that holds it panics.
        let mut accounts = self.by_address.lock().unwrap_or_else(PoisonError::into_inner);
        let address = network(address.unwrap_or(Ipv6Addr::UNSPECIFIED.into()));
        if accounts.len() >= ADDRESSES_MAX && !accounts.contains_key(&address) {
            accounts.retain(|_, account| {
                account.forget(now);
                account.wrong > 0
            });
            if accounts.len() >= ADDRESSES_MAX {
                // This many come from an attack. All further ones share one account until some are forgotten.
                let crowd = network(Ipv6Addr::UNSPECIFIED.into());
                let account = accounts.entry(crowd).or_insert(Account::new(now));
                account.forget(now);
                return work(account);
            }
        }
        let account = accounts.entry(address).or_insert(Account::new(now));
        account.forget(now);
        work(account)
    }
}

impl Account {
    const fn new(now: Instant) -> Self {
        Self { wrong: 0, since: now, has_been_right: false }
    }
}

/// A host has a whole network of 64 bits of IPv6 addresses.
fn network(address: IpAddr) -> IpAddr {
    match address.to_canonical() {
        IpAddr::V6(address) => {
            Ipv6Addr::from_bits(address.to_bits() & !u128::from(u64::MAX)).into()
        }
        v4 @ IpAddr::V4(_) => v4,
    }
}

#[cfg(test)]
mod tests {
    use std::net::Ipv4Addr;

    use super::*;

    #[tokio::test(start_paused = true)]
    async fn ten_wrong_tokens_are_allowed_and_then_one_in_six_seconds() {
        let (guesses, here) = (Guesses::default(), Some(Ipv4Addr::LOCALHOST.into()));
        for _ in 0..BURST {
            assert!(guesses.may_try(here) && guesses.was_wrong(here));
        }
        assert!(!guesses.may_try(here) && !guesses.was_wrong(here));
        let elsewhere = Some("192.0.2.1".parse().unwrap());
        assert!(guesses.may_try(elsewhere));
        tokio::time::advance(PAUSE * 2).await;
        assert!(guesses.may_try(here) && guesses.was_wrong(here) && !guesses.may_try(here));
        guesses.was_right(here);
        assert!(guesses.may_try(here) && !guesses.was_wrong(here));
    }

    #[tokio::test(start_paused = true)]
    async fn addresses_are_bounded_and_a_host_has_one_account() {
        let guesses = Guesses::default();
        let wrong = |address: IpAddr| guesses.was_wrong(Some(address));
        for last in 0..10 {
            assert!(wrong(Ipv6Addr::new(0x2001, 0xdb8, 0, 0, 0, 0, 0, last).into()));
        }
        assert!(!wrong(Ipv6Addr::new(0x2001, 0xdb8, 0, 0, 9, 9, 9, 9).into()));
        for address in 0..10_000 {
            wrong(Ipv4Addr::from_bits(0x0a00_0000 + address).into());
        }
        assert_eq!(guesses.by_address.lock().unwrap().len(), ADDRESSES_MAX + 1);
        tokio::time::advance(PAUSE * 20).await;
        assert!(wrong(Ipv4Addr::LOCALHOST.into()));
        assert_eq!(guesses.by_address.lock().unwrap().len(), 1);
    }
}
