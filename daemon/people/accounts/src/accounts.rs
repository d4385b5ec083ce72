//! The people that a daemon knows: signing in, sessions, and tokens of programs.

use std::net::IpAddr;
use std::path::PathBuf;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant, SystemTime};

use tokio::sync::watch;

use crate::attempts::SignInLimits;
use crate::error::{AccountsError, SignInRefusal};
use crate::password::{PASSWORD_BYTES_MAX, PasswordCost, StoredPassword};
use crate::people_file::{FileStamp, PeopleFile};
use crate::person_name::NAME_BYTES_MAX;
use crate::records::PeopleRecords;
use crate::right::Person;
use crate::secret::SecretDigest;
use crate::sessions::{NewSession, OpenSessions, SignedIn};

/// Maximum number of passwords that are checked at a time: each takes 19 MiB and a core. A guesser
/// must not take all of a board.
const CHECKS_MAX: usize = 2;

/// How old the last look at the file may be when a session is used. A look costs microseconds, and
/// the file is read only if it has changed.
const LOOK_AGAIN_AFTER: Duration = Duration::from_secs(1);

/// The people of an ecosystem as one daemon knows them, with their sessions.
///
/// All functions are quick, except [`Accounts::sign_in`], which blocks for tens of milliseconds, and
/// [`Accounts::refresh`], which reads a file.
#[derive(Debug)]
pub struct Accounts {
    file: PeopleFile,
    known: Mutex<KnownPeople>,
    sessions: Mutex<OpenSessions>,
    limits: Mutex<SignInLimits>,
    checks: AtomicUsize,
    changes: watch::Sender<u64>,
    /// Hash that is computed for a name that does not exist.
    cost: PasswordCost,
}

#[derive(Debug)]
struct KnownPeople {
    records: PeopleRecords,
    stamp: Option<FileStamp>,
    looked_at: Instant,
    /// Hash against which the password of an unknown name is checked, so that the answer takes as
    /// long as that for a known one.
    decoy: StoredPassword,
}

/// Leave to check one password. Dropping it returns it.
struct CheckPermit<'a>(&'a AtomicUsize);

// === impl CheckPermit ===

impl CheckPermit<'_> {
    fn take(checks: &AtomicUsize) -> Option<CheckPermit<'_>> {
        let more = |running: usize| (running < CHECKS_MAX).then_some(running + 1);
        let taken = checks.fetch_update(Ordering::AcqRel, Ordering::Acquire, more);
        taken.ok().map(|_| CheckPermit(checks))
    }
}

impl Drop for CheckPermit<'_> {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::AcqRel);
    }
}

/// Locks a table. A panic of another thread leaves the tables whole: each change is one insertion or
/// removal.
fn lock<T>(table: &Mutex<T>) -> MutexGuard<'_, T> {
    table.lock().unwrap_or_else(PoisonError::into_inner)
}

// === impl KnownPeople ===

impl KnownPeople {
    /// Returns the people of a file. `decoy` is used again if it costs as much as their passwords.
    fn new(
        records: PeopleRecords,
        stamp: Option<FileStamp>,
        decoy: Option<StoredPassword>,
        cost: PasswordCost,
    ) -> Result<KnownPeople, AccountsError> {
        let costs = records.iter().filter_map(|person| person.password.as_ref());
        let cost = costs.map(StoredPassword::cost).max().unwrap_or(cost);
        let decoy = match decoy.filter(|decoy| decoy.cost() == cost) {
            Some(decoy) => decoy,
            None => StoredPassword::hash("a decoy", cost)?,
        };
        Ok(KnownPeople { records, stamp, looked_at: Instant::now(), decoy })
    }
}

// === impl Accounts ===

impl Accounts {
    /// Reads the file of people. If it does not exist, no person is known until it does.
    ///
    /// # Errors
    ///
    /// Returns an error if the file cannot be read, if others can write it, or if it has mistakes.
    pub fn open(file: PathBuf) -> Result<Accounts, AccountsError> {
        Accounts::open_with(file, PasswordCost::RECOMMENDED)
    }

    /// Reads the file of people as [`Accounts::open`] does. `cost` is that of checking the password
    /// of a name that does not exist while the file has no password; tests make it cheap.
    ///
    /// # Errors
    ///
    /// Returns an error if the file cannot be read, if others can write it, or if it has mistakes.
    pub fn open_with(file: PathBuf, cost: PasswordCost) -> Result<Accounts, AccountsError> {
        let file = PeopleFile::new(file);
        // Taken before the text is read: a change between the two is then noticed at the next look.
        let stamp = file.stamp();
        let known = KnownPeople::new(file.read()?, stamp, None, cost)?;
        Ok(Accounts {
            file,
            known: Mutex::new(known),
            sessions: Mutex::default(),
            limits: Mutex::new(SignInLimits::new()),
            checks: AtomicUsize::new(0),
            changes: watch::Sender::new(0),
            cost,
        })
    }

    /// Reads the file again if it has changed; returns whether it has. Sessions of people that were
    /// removed, or that have another password, end at once, and rights are the new ones.
    ///
    /// # Errors
    ///
    /// Returns an error if the changed file cannot be read; it is logged, too. The people are then as
    /// before, and the file is read again when it changes.
    pub fn refresh(&self) -> Result<bool, AccountsError> {
        let stamp = self.file.stamp();
        let decoy = {
            let mut known = lock(&self.known);
            known.looked_at = Instant::now();
            if known.stamp == stamp {
                return Ok(false);
            }
            known.stamp = stamp;
            known.decoy.clone()
        };
        // Reading takes longer than others should wait for the table.
        let read = self.file.read();
        let fresh = read
            .and_then(|read| KnownPeople::new(read, stamp, Some(decoy), self.cost))
            .inspect_err(
                // Here, because some callers only use a session.
                |error| tracing::error!("people are as before: failed to {error}"),
            )?;
        let count = fresh.records.len();
        tracing::info!(file = %self.file.path().display(), count, "people were read again");
        let before = std::mem::replace(&mut *lock(&self.known), fresh);
        let known = lock(&self.known);
        lock(&self.sessions).keep_those_of(&known.records);
        let mut limits = lock(&self.limits);
        for person in before.records.iter() {
            let now = known.records.get(person.name.as_str());
            if now.is_none_or(|now| now.password != person.password) {
                limits.forget_addresses(person.name.as_str());
            }
        }
        drop((known, limits));
        self.count_change();
        Ok(true)
    }

    /// Whether no person is known.
    pub fn is_empty(&self) -> bool {
        lock(&self.known).records.is_empty()
    }

    /// Returns the people that are known, sorted by name.
    pub fn people(&self) -> Vec<Person> {
        lock(&self.known).records.iter().map(|record| record.person()).collect()
    }

    /// Returns the person with this name, with the present rights; `None` if there is none.
    pub fn person(&self, name: &str) -> Option<Person> {
        lock(&self.known).records.get(name).map(|record| record.person())
    }

    /// Signs a person in. Blocks for as long as a hash takes, tens of milliseconds.
    ///
    /// The answer, and the time that it takes, are the same for a wrong password and for a name that
    /// does not exist.
    ///
    /// # Errors
    ///
    /// Returns an error if the name or the password is wrong, if there were too many wrong attempts
    /// at this name or from this address, or if two passwords are being checked already.
    pub fn sign_in(
        &self,
        name: &str,
        password: &str,
        from: IpAddr,
        now: SystemTime,
    ) -> Result<NewSession, SignInRefusal> {
        // The people known so far count while the file has mistakes; the daemon reports these.
        let _ = self.refresh();
        // Every longer name is the same wrong one.
        let name = if name.len() <= NAME_BYTES_MAX { name } else { "" };
        let begun = lock(&self.limits).begin(name, from, now);
        let attempt = begun.map_err(|retry_after| SignInRefusal::TooMany { retry_after })?;
        let Some(permit) = CheckPermit::take(&self.checks) else {
            lock(&self.limits).cancel(&attempt);
            let reason = "others are signing in at this moment; try again in a second";
            return Err(SignInRefusal::Unavailable(reason.to_owned()));
        };
        let (stored, decoy) = {
            let known = lock(&self.known);
            let stored = known.records.get(name).and_then(|person| person.password.clone());
            (stored, known.decoy.clone())
        };
        let is_short = password.len() <= PASSWORD_BYTES_MAX;
        let checked = if is_short { password } else { "" };
        let is_right = stored.as_ref().unwrap_or(&decoy).is_of(checked);
        drop(permit);
        let known = lock(&self.known);
        // The person may have been removed, or the password changed, meanwhile.
        let person = known.records.get(name).filter(|person| person.password == stored);
        let (true, true, Some(person)) = (is_right && stored.is_some(), is_short, person) else {
            return Err(SignInRefusal::Wrong);
        };
        let begun = lock(&self.sessions).begin(&known.records, person.person(), now);
        let (session, ended) = match begun {
            Ok(begun) => begun,
            Err(error) => return Err(SignInRefusal::Unavailable(format!("failed to {error}"))),
        };
        drop(known);
        lock(&self.limits).succeed(&attempt, now);
        if ended > 0 {
            self.count_change();
        }
        Ok(session)
    }

    /// Returns the session with this secret, and counts the call as a request of its person; `None`
    /// if there is no such session, or if it has ended.
    pub fn session(&self, secret: &str, now: SystemTime) -> Option<SignedIn> {
        self.look_again();
        let known = lock(&self.known);
        lock(&self.sessions).used(&known.records, secret, now)
    }

    /// Returns the session with this secret as [`Accounts::session`] does, and does not count the call
    /// as a request: for what a page that is open asks for by itself.
    pub fn session_of_page(&self, secret: &str, now: SystemTime) -> Option<SignedIn> {
        self.look_again();
        let known = lock(&self.known);
        lock(&self.sessions).open(&known.records, secret, now)
    }

    /// Whether the session with this number is open. Does not count as a request: for a page that is
    /// open and shows what happens.
    pub fn is_open(&self, session: u64, now: SystemTime) -> bool {
        self.look_again();
        lock(&self.sessions).is_open(session, now)
    }

    /// Returns the person for which a program acts with this token.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no such token, and if there were too many wrong ones from this
    /// address. A right token is accepted in any case.
    pub fn program(
        &self,
        token: &str,
        from: IpAddr,
        now: SystemTime,
    ) -> Result<Person, SignInRefusal> {
        let person = self.with_token(token);
        person.ok_or_else(|| match lock(&self.limits).wrong_token(from, now) {
            Duration::ZERO => SignInRefusal::Wrong,
            retry_after => SignInRefusal::TooMany { retry_after },
        })
    }

    /// Returns the screen that has this token; `None` if there is none. Wrong tokens are not counted:
    /// a browser sends the one of a screen that was removed with each request.
    pub fn screen(&self, token: &str) -> Option<Person> {
        self.with_token(token).filter(|person| person.screen.is_some())
    }

    /// Returns the person, or the screen, that has a token. One that is not known may have been added
    /// a moment ago, so the file is looked at before it is refused.
    fn with_token(&self, token: &str) -> Option<Person> {
        let digest = SecretDigest::of(token)?;
        let find = || lock(&self.known).records.with_token(&digest).map(|record| record.person());
        self.look_again();
        find().or_else(|| {
            let _ = self.refresh();
            find()
        })
    }

    /// Ends the session with this secret.
    pub fn sign_out(&self, secret: &str) {
        if lock(&self.sessions).end(secret) {
            self.count_change();
        }
    }

    /// Returns a number that counts up whenever a session may have ended or rights may have changed,
    /// except by the passing of time.
    pub fn changes(&self) -> watch::Receiver<u64> {
        self.changes.subscribe()
    }

    fn count_change(&self) {
        self.changes.send_modify(|count| *count = count.wrapping_add(1));
    }

    /// Looks at the file if the last look is old. A file with mistakes leaves the people as they are.
    fn look_again(&self) {
        let is_due = lock(&self.known).looked_at.elapsed() >= LOOK_AGAIN_AFTER;
        if is_due {
            let _ = self.refresh();
        }
    }
}
