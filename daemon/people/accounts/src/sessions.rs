//! Sessions of people that have signed in: in memory only, so that a restart of the daemon ends all.

use std::collections::HashMap;
use std::fmt;
use std::time::{Duration, SystemTime};

use crate::error::AccountsError;
use crate::person_name::PersonName;
use crate::records::PeopleRecords;
use crate::right::Person;
use crate::secret::{SecretDigest, random_secret};

/// How long a session lasts at most: a working day, so that a caretaker signs in once a day, and a
/// stolen cookie is worth no more than that.
pub const SESSION_LASTS: Duration = Duration::from_secs(12 * 3_600);

/// How long a session lasts without a request of its person. A page that is only open does not count:
/// the screen of a robot or of a hall is used by one person after another.
pub const SESSION_IDLE_MAX: Duration = Duration::from_secs(30 * 60);

/// Maximum number of sessions of one person: a phone, a tablet and the browsers of some machines. The
/// one that was used longest ago ends.
const SESSIONS_OF_PERSON_MAX: usize = 16;

/// Maximum number of sessions of one daemon, some hundred bytes each.
const SESSIONS_MAX: usize = 2_048;

/// A person that has signed in, as a session gives it.
#[derive(Clone, PartialEq, Eq)]
pub struct SignedIn {
    /// Person with the present rights.
    pub person: Person,
    /// Text that each request that changes something must carry besides the cookie; other sites
    /// cannot read it.
    pub csrf: String,
    /// Time at which the session ends if the person makes no further request.
    pub ends_at: SystemTime,
    /// Number of the session in this daemon; no secret.
    pub session: u64,
}

/// A new session, with the secret that the browser keeps in a cookie.
pub struct NewSession {
    /// Secret of the session. The daemon keeps its digest only.
    pub secret: String,
    /// Person and further values of the session.
    pub signed_in: SignedIn,
}

#[derive(Debug)]
struct OpenSession {
    id: u64,
    person: PersonName,
    /// Digest of the hash of the password with which the person signed in: another password ends the
    /// session.
    password: SecretDigest,
    csrf: String,
    began: SystemTime,
    used: SystemTime,
}

/// The sessions of a daemon.
#[derive(Debug, Default)]
pub(crate) struct OpenSessions {
    sessions: HashMap<SecretDigest, OpenSession>,
    last_id: u64,
}

/// Returns the digest by which a change of a person's password is noticed; `None` if the person has
/// none.
fn password_digest(people: &PeopleRecords, name: &str) -> Option<SecretDigest> {
    let password = people.get(name)?.password.as_ref()?;
    Some(SecretDigest::of_bytes(password.as_str().as_bytes()))
}

// === impl SignedIn ===

impl SignedIn {
    /// Whether `given` is the text that a request of this session must carry.
    pub fn has_csrf(&self, given: &str) -> bool {
        // Digests are compared, so the time reveals nothing about the text.
        SecretDigest::of(given) == SecretDigest::of(&self.csrf)
    }
}

impl fmt::Debug for SignedIn {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let SignedIn { person, ends_at, session, .. } = self;
        let mut shown = f.debug_struct("SignedIn");
        shown.field("person", person).field("ends_at", ends_at).field("session", session);
        shown.finish_non_exhaustive()
    }
}

impl fmt::Debug for NewSession {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut shown = f.debug_struct("NewSession");
        shown.field("signed_in", &self.signed_in).finish_non_exhaustive()
    }
}

// === impl OpenSession ===

impl OpenSession {
    fn ends_at(&self) -> SystemTime {
        (self.began + SESSION_LASTS).min(self.used + SESSION_IDLE_MAX)
    }

    fn has_ended(&self, now: SystemTime) -> bool {
        now >= self.ends_at()
    }

    fn signed_in(&self, person: Person) -> SignedIn {
        let (csrf, ends_at) = (self.csrf.clone(), self.ends_at());
        SignedIn { person, csrf, ends_at, session: self.id }
    }
}

// === impl OpenSessions ===

impl OpenSessions {
    /// Begins a session of a person. Returns it with the number of sessions that ended for it.
    pub(crate) fn begin(
        &mut self,
        people: &PeopleRecords,
        person: Person,
        now: SystemTime,
    ) -> Result<(NewSession, usize), AccountsError> {
        let (secret, csrf) = (random_secret()?, random_secret()?);
        let Some(password) = password_digest(people, person.name.as_str()) else {
            let known = Vec::new();
            return Err(AccountsError::Unknown { name: person.name.to_string(), known });
        };
        let before = self.sessions.len();
        self.sessions.retain(|_, session| !session.has_ended(now));
        let of_person = |session: &OpenSession| session.person == person.name;
        let count = self.sessions.values().filter(|session| of_person(session)).count();
        if count >= SESSIONS_OF_PERSON_MAX {
            self.end_oldest(of_person);
        } else if self.sessions.len() >= SESSIONS_MAX {
            self.end_oldest(|_| true);
        }
        let ended = before - self.sessions.len();
        self.last_id += 1;
        let name = person.name.clone();
        let (began, used, id) = (now, now, self.last_id);
        let session = OpenSession { id, person: name, password, csrf, began, used };
        let signed_in = session.signed_in(person);
        self.sessions.insert(SecretDigest::of_bytes(secret.as_bytes()), session);
        Ok((NewSession { secret, signed_in }, ended))
    }

    fn end_oldest(&mut self, which: impl Fn(&OpenSession) -> bool) {
        let those = self.sessions.iter().filter(|(_, session)| which(session));
        let oldest = those.min_by_key(|(_, session)| (session.used, session.id));
        if let Some(digest) = oldest.map(|(digest, _)| *digest) {
            self.sessions.remove(&digest);
        }
    }

    /// Returns the session with this secret, and counts the call as a use of it; `None` if there is
    /// no such session, or if it has ended.
    pub(crate) fn used(
        &mut self,
        people: &PeopleRecords,
        secret: &str,
        now: SystemTime,
    ) -> Option<SignedIn> {
        let signed_in = self.open(people, secret, now)?;
        let session = self.sessions.get_mut(&SecretDigest::of(secret)?)?;
        session.used = now;
        Some(signed_in)
    }

    /// Returns the session with this secret, without counting a use of it; `None` if there is no such
    /// session, or if it has ended.
    pub(crate) fn open(
        &mut self,
        people: &PeopleRecords,
        secret: &str,
        now: SystemTime,
    ) -> Option<SignedIn> {
        let digest = SecretDigest::of(secret)?;
        let session = self.sessions.get_mut(&digest)?;
        if session.has_ended(now) {
            self.sessions.remove(&digest);
            return None;
        }
        let person = people.get(session.person.as_str())?.person();
        // After a clock was set back, the session begins at its new time, and so ends in any case.
        session.began = session.began.min(now);
        session.used = session.used.min(now);
        Some(session.signed_in(person))
    }

    /// Whether the session with this number is open. Does not count as a use.
    pub(crate) fn is_open(&self, id: u64, now: SystemTime) -> bool {
        self.sessions.values().any(|session| session.id == id && !session.has_ended(now))
    }

    /// Ends the session with this secret; returns whether there was one.
    pub(crate) fn end(&mut self, secret: &str) -> bool {
        let digest = SecretDigest::of(secret);
        digest.is_some_and(|digest| self.sessions.remove(&digest).is_some())
    }

    /// Ends the sessions of people that are gone or have another password; returns their number.
    pub(crate) fn keep_those_of(&mut self, people: &PeopleRecords) -> usize {
        let before = self.sessions.len();
        self.sessions.retain(|_, session| {
            password_digest(people, session.person.as_str()) == Some(session.password)
        });
        before - self.sessions.len()
    }
}
