//! The caller of a request: a person by the cookie of a session, a program by a token, or the screen
//! of an agent by the cookie with its token.

use std::net::IpAddr;
use std::sync::atomic::Ordering;
use std::time::SystemTime;

use accounts::{Accounts, Person, PersonRight, SecretDigest, SignInRefusal, SignedIn};
use axum::http::header::{self, HeaderName};
use axum::http::{HeaderMap, StatusCode};

use crate::answer::Refused;
use crate::caller_key::CallerKey;
use crate::connection::PageClient;
use crate::server_state::ServerState;
use crate::topic_name::TopicName;

/// Header with the text that shows that a page of this server has made the request.
pub(crate) const CSRF: HeaderName = HeaderName::from_static("x-althing-csrf");

/// Header with which a page says that it asks by itself, and not for a person: such a request does
/// not prolong the session.
const BY_PAGE: HeaderName = HeaderName::from_static("x-althing-by-page");

/// The caller of a request, after signing in.
pub(crate) enum Caller {
    /// A person with a session.
    Session(SignedIn),
    /// A program with the token of a person.
    Program { person: Person, token: String, from: IpAddr },
    /// The screen of an agent, at which no person has signed in.
    Screen { person: Person, token: String },
}

impl Caller {
    /// Returns the caller of a request.
    ///
    /// # Errors
    ///
    /// Returns a refusal if the request has neither a session that is open nor a known token.
    pub(crate) fn of(
        state: &ServerState,
        headers: &HeaderMap,
        client: &PageClient,
    ) -> Result<Caller, Refused> {
        let (accounts, now) = (&state.accounts, SystemTime::now());
        let caller = match headers.get(header::AUTHORIZATION) {
            Some(given) => {
                let token = given.to_str().ok().and_then(|it| it.strip_prefix("Bearer "));
                let Some(token) = token else {
                    let problem = "the header Authorization is `Bearer TOKEN`";
                    return Err(Refused::new(StatusCode::UNAUTHORIZED, problem));
                };
                let person = accounts.program(token, client.from, now).map_err(not_a_program)?;
                Caller::Program { person, token: token.to_owned(), from: client.from }
            }
            None => {
                let secret = state.cookies.session(headers);
                let signed_in = secret.and_then(|secret| match headers.contains_key(BY_PAGE) {
                    true => accounts.session_of_page(secret, now),
                    false => accounts.session(secret, now),
                });
                let unknown = || Refused::new(StatusCode::UNAUTHORIZED, "sign in first");
                // At a screen, a person that has signed in goes before the screen.
                let caller = signed_in.map(Caller::Session);
                caller.or_else(|| Caller::screen(state, headers)).ok_or_else(unknown)?
            }
        };
        client.is_known.store(true, Ordering::Relaxed);
        Ok(caller)
    }

    /// Returns the screen whose token a request has; `None` if it has none that is known.
    fn screen(state: &ServerState, headers: &HeaderMap) -> Option<Caller> {
        let token = state.cookies.screen(headers)?;
        let person = state.accounts.screen(token)?;
        Some(Caller::Screen { person, token: token.to_owned() })
    }

    /// Returns the person.
    pub(crate) fn person(&self) -> &Person {
        match self {
            Caller::Session(signed_in) => &signed_in.person,
            Caller::Program { person, .. } | Caller::Screen { person, .. } => person,
        }
    }

    /// Returns the text that each request of this caller that changes something must carry; `None`
    /// for a program.
    pub(crate) fn csrf(&self) -> Option<String> {
        match self {
            Caller::Session(signed_in) => Some(signed_in.csrf.clone()),
            Caller::Program { .. } => None,
            Caller::Screen { token, .. } => csrf_of(token),
        }
    }

    /// Returns the key by which requests of this caller are counted.
    pub(crate) fn key(&self) -> CallerKey {
        match self {
            Caller::Session(signed_in) => CallerKey::Session(signed_in.session),
            Caller::Program { person, .. } | Caller::Screen { person, .. } => {
                CallerKey::Program(person.name.clone())
            }
        }
    }

    /// Whether the caller may still see what is to be seen. Does not count as a request of the
    /// person.
    pub(crate) fn may_look(&self, accounts: &Accounts) -> bool {
        let now = SystemTime::now();
        match self {
            Caller::Session(signed_in) => {
                let known = accounts.person(signed_in.person.name.as_str());
                accounts.is_open(signed_in.session, now)
                    && known.is_some_and(|known| known.may(PersonRight::Look))
            }
            Caller::Program { person, token, from } => {
                let known = accounts.program(token, *from, now);
                known.is_ok_and(|known| {
                    let is_same = known.name == person.name && known.screen == person.screen;
                    is_same && (known.may(PersonRight::Look) || known.screen.is_some())
                })
            }
            Caller::Screen { person, token } => {
                accounts.screen(token).is_some_and(|known| known == *person)
            }
        }
    }

    /// Checks that the caller may see these topics: a person with the right to look all, the screen
    /// of an agent those about this agent.
    ///
    /// # Errors
    ///
    /// Returns a refusal otherwise.
    pub(crate) fn check_topics(&self, topics: &[TopicName]) -> Result<(), Refused> {
        let Some(agent) = &self.person().screen else { return self.require(PersonRight::Look) };
        let is_own =
            |topic: &TopicName| matches!(topic, TopicName::Robot(of) if of.as_str() == agent);
        if topics.iter().all(is_own) {
            return Ok(());
        }
        let problem = format!("the screen of {agent} shows this agent only; sign in to see more");
        Err(Refused::new(StatusCode::FORBIDDEN, problem))
    }

    /// Checks that the person has a right.
    ///
    /// # Errors
    ///
    /// Returns a refusal otherwise.
    pub(crate) fn require(&self, right: PersonRight) -> Result<(), Refused> {
        if self.person().may(right) {
            return Ok(());
        }
        let name = &self.person().name;
        let problem = match &self.person().screen {
            Some(agent) => format!("the screen of {agent} may not {}; sign in first", deed(right)),
            None => {
                let (deed, right) = (deed(right), right.as_str());
                format!("{name} may not {deed}: the right `{right}` is missing")
            }
        };
        Err(Refused::new(StatusCode::FORBIDDEN, problem))
    }

    /// Checks that a request that changes something carries the text that only pages of this server
    /// can read. A program needs none: no browser sends its token by itself.
    ///
    /// # Errors
    ///
    /// Returns a refusal otherwise.
    pub(crate) fn check_csrf(&self, headers: &HeaderMap) -> Result<(), Refused> {
        let mut given = headers.get_all(CSRF).iter();
        let (first, second) = (given.next(), given.next());
        let text = first.and_then(|text| text.to_str().ok()).filter(|_| second.is_none());
        let is_right = match self {
            Caller::Session(signed_in) => text.is_some_and(|text| signed_in.has_csrf(text)),
            Caller::Program { .. } => true,
            Caller::Screen { token, .. } => text.is_some_and(|text| {
                // Digests are compared, so the time reveals nothing about the text.
                let wanted = csrf_of(token).and_then(|wanted| SecretDigest::of(&wanted));
                wanted.is_some() && wanted == SecretDigest::of(text)
            }),
        };
        if is_right {
            return Ok(());
        }
        let problem = "the request does not carry the token of the session (header X-Althing-CSRF)";
        Err(Refused::new(StatusCode::FORBIDDEN, problem))
    }
}

/// Returns the text that requests of a screen must carry. Whoever knows it does not know the token.
fn csrf_of(token: &str) -> Option<String> {
    SecretDigest::of(&format!("requests of the screen {token}")).map(|digest| digest.to_string())
}

fn not_a_program(refusal: SignInRefusal) -> Refused {
    match refusal {
        SignInRefusal::Wrong => Refused::new(StatusCode::UNAUTHORIZED, "the token is not known"),
        other => refusal_of(&other),
    }
}

/// Returns the answer to a refused attempt to sign in.
pub(crate) fn refusal_of(refusal: &SignInRefusal) -> Refused {
    let problem = refusal.to_string();
    match refusal {
        SignInRefusal::Wrong => Refused::new(StatusCode::UNAUTHORIZED, problem),
        SignInRefusal::TooMany { retry_after } => {
            Refused::new(StatusCode::TOO_MANY_REQUESTS, problem).again_after(*retry_after)
        }
        SignInRefusal::Unavailable(_) => Refused::new(StatusCode::SERVICE_UNAVAILABLE, problem),
    }
}

/// Returns the word for what a right allows.
fn deed(right: PersonRight) -> &'static str {
    match right {
        PersonRight::Look => "look at this ecosystem",
        PersonRight::Ask => "ask for anything",
        PersonRight::Change => "change facts",
        PersonRight::Admit => "admit agents",
        PersonRight::Stop => "release stops",
        PersonRight::Secrets => "see what is private",
    }
}
