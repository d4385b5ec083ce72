//! Limits of wrong attempts to sign in: after some free ones each costs a growing wait, up to a cap.
//!
//! A wait never grows without end, and an attempt that is refused does not prolong it. So a guesser
//! slows down, and keeps no person out for ever.

use std::collections::HashMap;
use std::hash::Hash;
use std::net::{IpAddr, Ipv6Addr};
use std::time::{Duration, SystemTime};

/// Wrong attempts at a name, from anywhere, that cost no wait: people mistype.
const NAME_FREE: u32 = 5;

/// Longest wait for a name. A guesser with many addresses has one guess in this time, three thousand
/// a day; a person at a new address waits no longer than this.
const NAME_WAIT_MAX: Duration = Duration::from_secs(30);

/// Wrong attempts from an address that cost no wait: a few people mistype behind one router.
const ADDRESS_FREE: u32 = 10;

/// Longest wait of an address. Only the address of a guesser waits so long.
const ADDRESS_WAIT_MAX: Duration = Duration::from_secs(15 * 60);

/// The wait after the first attempt that is not free; it doubles with each further one.
const WAIT_FIRST: Duration = Duration::from_secs(1);

/// How long an attempt is remembered without a further one. Longer than every wait, so that waiting
/// it out does not begin anew with free attempts.
const FORGOTTEN_AFTER: Duration = Duration::from_secs(60 * 60);

/// Maximum number of names, and of addresses, that are remembered.
const REMEMBERED_MAX: usize = 4_096;

/// How long an address counts as one from which a person signs in. A caretaker on leave comes back
/// within it.
const KNOWN_ADDRESS_FOR: Duration = Duration::from_secs(30 * 24 * 3_600);

/// Maximum number of pairs of a person and an address that are remembered.
const KNOWN_ADDRESSES_MAX: usize = 8_192;

/// Limits of one kind of attempt.
#[derive(Clone, Copy, Debug)]
struct AttemptRule {
    free: u32,
    wait_max: Duration,
}

#[derive(Clone, Copy, Debug)]
struct AttemptCount {
    wrong: u32,
    last: SystemTime,
}

/// Counts of wrong attempts by a key. The table has a bound: the key with the fewest attempts, the
/// oldest of these, makes room. So a guesser cannot clear the count of a name by guessing at others.
#[derive(Debug)]
struct AttemptTable<K> {
    rule: AttemptRule,
    counts: HashMap<K, AttemptCount>,
}

/// All limits of a daemon.
#[derive(Debug)]
pub(crate) struct SignInLimits {
    names: AttemptTable<String>,
    addresses: AttemptTable<IpAddr>,
    /// Attempts at a name from an address from which the person has signed in. These alone count
    /// there, so that a guesser elsewhere does not make the person wait.
    known: AttemptTable<(String, IpAddr)>,
    known_since: HashMap<(String, IpAddr), SystemTime>,
    programs: AttemptTable<IpAddr>,
}

/// An attempt that counts as wrong until it is found to be right.
#[derive(Clone, Debug)]
pub(crate) struct SignInAttempt {
    name: String,
    address: IpAddr,
    is_known: bool,
}

/// Returns the address that counts: of IPv6 the network, because a machine there has as many addresses
/// as it likes; IPv4 that is written as IPv6 is IPv4.
fn counted(address: IpAddr) -> IpAddr {
    /// The part of an IPv6 address that a router gives to one machine or home.
    const NETWORK: u128 = !0 << 64;
    match address.to_canonical() {
        IpAddr::V6(address) => Ipv6Addr::from_bits(address.to_bits() & NETWORK).into(),
        address => address,
    }
}

/// Returns the time since `then`. A clock that was set back counts as no time.
fn since(then: SystemTime, now: SystemTime) -> Duration {
    now.duration_since(then).unwrap_or_default()
}

// === impl AttemptRule ===

impl AttemptRule {
    /// Returns the wait after so many wrong attempts.
    fn wait(self, wrong: u32) -> Duration {
        match wrong.checked_sub(self.free) {
            None | Some(0) => Duration::ZERO,
            Some(paid) => {
                let factor = 1_u32.checked_shl(paid - 1).unwrap_or(u32::MAX);
                WAIT_FIRST.saturating_mul(factor).min(self.wait_max)
            }
        }
    }
}

// === impl AttemptTable ===

impl<K: Hash + Eq + Clone> AttemptTable<K> {
    fn new(free: u32, wait_max: Duration) -> AttemptTable<K> {
        AttemptTable { rule: AttemptRule { free, wait_max }, counts: HashMap::new() }
    }

    /// Returns how long an attempt at this key has to wait; zero if it need not.
    fn wait(&mut self, key: &K, now: SystemTime) -> Duration {
        let Some(count) = self.counts.get_mut(key) else { return Duration::ZERO };
        // After a clock was set back, the wait begins at its new time.
        count.last = count.last.min(now);
        self.rule.wait(count.wrong).saturating_sub(since(count.last, now))
    }

    /// Counts an attempt as wrong.
    fn charge(&mut self, key: K, now: SystemTime) {
        if !self.counts.contains_key(&key) && self.counts.len() >= REMEMBERED_MAX {
            self.make_room(now);
        }
        let fresh = AttemptCount { wrong: 0, last: now };
        let count = self.counts.entry(key).or_insert(fresh);
        if since(count.last, now) >= FORGOTTEN_AFTER {
            count.wrong = 0;
        }
        count.wrong = count.wrong.saturating_add(1);
        count.last = now;
    }

    /// Takes back one wrong attempt, which was right.
    fn refund(&mut self, key: &K) {
        if let Some(count) = self.counts.get_mut(key) {
            count.wrong = count.wrong.saturating_sub(1);
        }
    }

    fn make_room(&mut self, now: SystemTime) {
        self.counts.retain(|_, count| since(count.last, now) < FORGOTTEN_AFTER);
        if self.counts.len() < REMEMBERED_MAX {
            return;
        }
        let least = self.counts.iter().min_by_key(|(_, count)| (count.wrong, count.last));
        if let Some(key) = least.map(|(key, _)| key.clone()) {
            self.counts.remove(&key);
        }
    }
}

// === impl SignInLimits ===

impl SignInLimits {
    pub(crate) fn new() -> SignInLimits {
        SignInLimits {
            names: AttemptTable::new(NAME_FREE, NAME_WAIT_MAX),
            addresses: AttemptTable::new(ADDRESS_FREE, ADDRESS_WAIT_MAX),
            known: AttemptTable::new(NAME_FREE, NAME_WAIT_MAX),
            known_since: HashMap::new(),
            programs: AttemptTable::new(ADDRESS_FREE, NAME_WAIT_MAX),
        }
    }

    /// Begins an attempt to sign in, and counts it as wrong until [`SignInLimits::succeed`]: so
    /// attempts at the same instant count, too. Returns the wait as the error.
    pub(crate) fn begin(
        &mut self,
        name: &str,
        from: IpAddr,
        now: SystemTime,
    ) -> Result<SignInAttempt, Duration> {
        let attempt = self.attempt(name, from, now);
        let wait = self.wait(&attempt, now);
        if !wait.is_zero() {
            return Err(wait);
        }
        let SignInAttempt { name, address, is_known } = attempt.clone();
        if is_known {
            self.known.charge((name, address), now);
        } else {
            self.names.charge(name, now);
            self.addresses.charge(address, now);
        }
        Ok(attempt)
    }

    fn attempt(&self, name: &str, from: IpAddr, now: SystemTime) -> SignInAttempt {
        let key = (name.to_owned(), counted(from));
        let is_known =
            self.known_since.get(&key).is_some_and(|then| since(*then, now) < KNOWN_ADDRESS_FOR);
        let (name, address) = key;
        SignInAttempt { name, address, is_known }
    }

    fn wait(&mut self, attempt: &SignInAttempt, now: SystemTime) -> Duration {
        let SignInAttempt { name, address, is_known } = attempt;
        match is_known {
            true => self.known.wait(&(name.clone(), *address), now),
            false => self.names.wait(name, now).max(self.addresses.wait(address, now)),
        }
    }

    /// Ends an attempt with the right password. Earlier wrong attempts stay counted: a guesser with
    /// a name of its own must not clear them by signing in.
    pub(crate) fn succeed(&mut self, attempt: &SignInAttempt, now: SystemTime) {
        self.cancel(attempt);
        let SignInAttempt { name, address, .. } = attempt;
        let key = (name.clone(), *address);
        if !self.known_since.contains_key(&key) && self.known_since.len() >= KNOWN_ADDRESSES_MAX {
            let oldest = self.known_since.iter().min_by_key(|(_, then)| **then);
            if let Some(oldest) = oldest.map(|(key, _)| key.clone()) {
                self.known_since.remove(&oldest);
            }
        }
        self.known_since.insert(key, now);
    }

    /// Ends an attempt without a check of its password: it does not count.
    pub(crate) fn cancel(&mut self, attempt: &SignInAttempt) {
        let SignInAttempt { name, address, is_known } = attempt;
        if *is_known {
            self.known.refund(&(name.clone(), *address));
        } else {
            self.names.refund(name);
            self.addresses.refund(address);
        }
    }

    /// Forgets the addresses of a person that was removed, or that has another password.
    pub(crate) fn forget_addresses(&mut self, name: &str) {
        self.known_since.retain(|(known, _), _| known != name);
    }

    /// Counts a wrong token from an address. Returns the wait for the next one; zero if there is
    /// none. A right token is never made to wait: no guess is one.
    pub(crate) fn wrong_token(&mut self, from: IpAddr, now: SystemTime) -> Duration {
        let address = counted(from);
        let wait = self.programs.wait(&address, now);
        if wait.is_zero() {
            self.programs.charge(address, now);
        }
        wait
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CARETAKER: IpAddr = IpAddr::V4(std::net::Ipv4Addr::new(192, 168, 1, 2));
    const GUESSER: IpAddr = IpAddr::V4(std::net::Ipv4Addr::new(192, 168, 1, 66));

    fn start() -> SystemTime {
        SystemTime::UNIX_EPOCH + Duration::from_secs(1_000_000_000)
    }

    /// Signs in with the right password.
    fn enter(limits: &mut SignInLimits, from: IpAddr, now: SystemTime) -> bool {
        let begun = limits.begin("anna", from, now);
        begun.map(|attempt| limits.succeed(&attempt, now)).is_ok()
    }

    #[test]
    fn waits_double_up_to_a_cap() {
        let rule = AttemptRule { free: 5, wait_max: NAME_WAIT_MAX };
        let waits: Vec<_> = (0..13).map(|wrong| rule.wait(wrong).as_secs()).collect();
        assert_eq!(waits, [0, 0, 0, 0, 0, 0, 1, 2, 4, 8, 16, 30, 30]);
        assert_eq!(rule.wait(u32::MAX), NAME_WAIT_MAX);
    }

    #[test]
    fn a_guesser_at_one_address_has_few_guesses_a_day() {
        let mut limits = SignInLimits::new();
        let (mut now, mut guesses) = (start(), 0);
        let end = now + Duration::from_secs(24 * 3_600);
        while now < end {
            match limits.begin("anna", GUESSER, now) {
                Ok(_) => guesses += 1,
                Err(wait) => now += wait,
            }
        }
        assert!((100..130).contains(&guesses), "{guesses}");
    }

    #[test]
    fn a_guesser_with_many_addresses_has_a_guess_in_half_a_minute() {
        let mut limits = SignInLimits::new();
        let (mut now, mut guesses, mut address) = (start(), 0, 1_u32);
        let end = now + Duration::from_secs(24 * 3_600);
        while now < end {
            address += 1;
            match limits.begin("anna", IpAddr::V4(address.into()), now) {
                Ok(_) => guesses += 1,
                Err(wait) => now += wait,
            }
        }
        assert!((2_800..2_900).contains(&guesses), "{guesses}");
        assert!(limits.addresses.counts.len() <= REMEMBERED_MAX);
    }

    #[test]
    fn a_guesser_does_not_keep_the_caretaker_out() {
        let mut limits = SignInLimits::new();
        let now = start();
        assert!(enter(&mut limits, CARETAKER, now));
        for _ in 0..100 {
            let _ = limits.begin("anna", GUESSER, now);
        }
        assert!(limits.begin("anna", GUESSER, now).is_err());
        assert!(enter(&mut limits, CARETAKER, now), "the address is known");
        let elsewhere = IpAddr::from([10, 0, 0, 1]);
        assert!(!enter(&mut limits, elsewhere, now), "another address waits");
        assert!(enter(&mut limits, elsewhere, now + NAME_WAIT_MAX), "for half a minute at most");
        limits.forget_addresses("anna");
        assert!(!limits.attempt("anna", CARETAKER, now).is_known);
    }

    #[test]
    fn a_guesser_with_a_name_of_its_own_does_not_clear_its_count() {
        let mut limits = SignInLimits::new();
        let now = start();
        for _ in 0..ADDRESS_FREE {
            let own = limits.begin("mallory", GUESSER, now).expect("no wait yet");
            limits.succeed(&own, now);
            let _ = limits.begin("anna", GUESSER, now);
        }
        assert!(limits.begin("anna", GUESSER, now).is_err());
    }

    #[test]
    fn attempts_that_are_refused_do_not_prolong_the_wait() {
        let mut limits = SignInLimits::new();
        let mut now = start();
        while limits.begin("anna", GUESSER, now).is_ok() {}
        let waited = limits.begin("anna", GUESSER, now).expect_err("a wait");
        for _ in 0..10 {
            now += waited / 20;
            assert!(limits.begin("anna", GUESSER, now).is_err());
        }
        assert!(limits.begin("anna", GUESSER, start() + waited).is_ok());
    }

    #[test]
    fn guesses_at_other_names_do_not_clear_the_count_of_one() {
        let mut limits = SignInLimits::new();
        let now = start();
        for address in 0..20_u32 {
            let _ = limits.begin("anna", IpAddr::V4(address.into()), now);
        }
        for other in 0..2 * REMEMBERED_MAX {
            let address = IpAddr::V6((u128::try_from(other).expect("small") << 64).into());
            let _ = limits.begin(&format!("x{other}"), address, now);
        }
        assert!(limits.names.counts.len() <= REMEMBERED_MAX);
        assert!(limits.begin("anna", CARETAKER, now).is_err());
    }

    #[test]
    fn addresses_of_one_network_count_as_one() {
        let one = counted("2001:db8:1:2::1".parse().expect("an address"));
        assert_eq!(one, counted("2001:db8:1:2:ffff::9".parse().expect("an address")));
        assert_ne!(one, counted("2001:db8:1:3::1".parse().expect("an address")));
        assert_eq!(counted("::ffff:192.168.1.2".parse().expect("an address")), CARETAKER);
    }

    #[test]
    fn a_clock_that_is_set_back_keeps_no_person_out_longer_than_the_cap() {
        let mut limits = SignInLimits::new();
        while limits.begin("anna", CARETAKER, start()).is_ok() {}
        let before = start() - Duration::from_secs(365 * 24 * 3_600);
        let wait = limits.begin("anna", CARETAKER, before).expect_err("a wait");
        assert!(wait <= ADDRESS_WAIT_MAX, "{wait:?}");
        assert!(limits.begin("anna", CARETAKER, before + wait).is_ok());
    }

    #[test]
    fn wrong_tokens_are_slowed_down() {
        let mut limits = SignInLimits::new();
        let waits: Vec<_> = (0..20).map(|_| limits.wrong_token(GUESSER, start())).collect();
        assert!(waits[0].is_zero() && !waits[19].is_zero(), "{waits:?}");
    }
}
