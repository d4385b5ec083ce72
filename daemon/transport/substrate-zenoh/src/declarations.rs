//! Everything that a session declares: its subscribers, its queryables and its tokens. All these
//! declarations can be made again.
//!
//! Zenoh does not send a declaration to routers that seem to have it already. So a repeated
//! declaration uses another key expression with the same meaning, where there is one. It is not
//! enough to undeclare the old key expression, because another session at the same router may have
//! declared it too.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};

use acl::{AgentId, Incarnation};
use substrate::Inbound;
use zenoh::liveliness::LivelinessToken;
use zenoh::pubsub::Subscriber;
use zenoh::query::Queryable;
use zenoh::{Session, Wait};

use crate::inbound;
use crate::key_expr::KeySpace;
use crate::known_sessions::KnownSessions;
use crate::open_error::{OpenError, undeclared};
use crate::queries::{AnnouncedAgents, QueryResponder};
use crate::revocations;
use crate::sealing::Security;

/// Declarations of one session to Zenoh: its subscribers, queryables and liveliness tokens.
pub(crate) struct Declarations {
    keys: KeySpace,
    /// Weak reference, because the session's callbacks hold these declarations.
    session: Weak<Session>,
    inbound: Arc<dyn Inbound>,
    security: Option<Security>,
    known_sessions: KnownSessions,
    /// Number of times that all declarations were made again.
    round: AtomicU64,
    held: Mutex<HeldDeclarations>,
}

#[derive(Default)]
struct HeldDeclarations {
    entities: Vec<ZenohDeclaration>,
    /// Agents that this daemon has announced, each with its liveliness token; only these may have a
    /// model. The token is `None` while it is being declared.
    residents: BTreeMap<(AgentId, Incarnation), Option<LivelinessToken>>,
}

/// A declaration, which is valid for as long as this value is held.
enum ZenohDeclaration {
    Subscriber(Subscriber<()>),
    Queryable(Queryable<()>),
    Token(LivelinessToken),
}

// === impl Declarations ===

impl Declarations {
    /// Makes the declarations that every session has.
    pub(crate) fn declare(
        session: &Arc<Session>,
        keys: &KeySpace,
        inbound: &Arc<dyn Inbound>,
        security: Option<&Security>,
        known_sessions: &KnownSessions,
    ) -> Result<Arc<Declarations>, OpenError> {
        let declarations = Arc::new(Declarations {
            keys: keys.clone(),
            session: Arc::downgrade(session),
            inbound: Arc::clone(inbound),
            security: security.cloned(),
            known_sessions: known_sessions.clone(),
            round: AtomicU64::new(0),
            held: Mutex::default(),
        });
        let entities = declarations.entities(session, 0)?;
        declarations.lock().entities = entities;
        Ok(declarations)
    }

    /// Makes all declarations again. Messages to this session are lost in the instant between the
    /// old and the new declaration, as on any bad link. All agents stay present, because the new
    /// token of each is declared before the old one is undeclared.
    pub(crate) fn redeclare_all(self: &Arc<Self>) {
        let Some(session) = self.session.upgrade().filter(|session| !session.is_closed()) else {
            return;
        };
        let telling = self.round.fetch_add(1, Ordering::Relaxed) + 1;
        let old = std::mem::take(&mut self.lock().entities);
        old.into_iter().for_each(ZenohDeclaration::undeclare);
        match self.entities(&session, telling) {
            Ok(entities) => self.lock().entities = entities,
            Err(error) => tracing::error!(%error, "failed to announce the agents again"),
        }
        for (agent, incarnation) in self.residents() {
            self.declare_token(&session, agent, incarnation, telling);
        }
    }

    /// Announces an agent: declares its token, which remains until [`Declarations::withdraw`].
    pub(crate) fn announce(
        &self,
        session: &Session,
        agent: &AgentId,
        incarnation: Incarnation,
    ) -> zenoh::Result<()> {
        self.lock().residents.insert((agent.clone(), incarnation), None);
        let telling = self.round.load(Ordering::Relaxed);
        let key_expr = self.keys.alive(agent, incarnation, telling);
        let token = session.liveliness().declare_token(key_expr).wait()?;
        self.replace_token(agent.clone(), incarnation, token);
        Ok(())
    }

    pub(crate) fn withdraw(&self, agent: &AgentId, incarnation: Incarnation) {
        let token = self.lock().residents.remove(&(agent.clone(), incarnation));
        if let Some(token) = token.flatten() {
            ZenohDeclaration::Token(token).undeclare();
        }
    }

    fn declare_token(
        &self,
        session: &Session,
        agent: AgentId,
        incarnation: Incarnation,
        telling: u64,
    ) {
        let key_expr = self.keys.alive(&agent, incarnation, telling);
        match session.liveliness().declare_token(key_expr).wait() {
            Ok(token) => self.replace_token(agent, incarnation, token),
            Err(error) => tracing::debug!(%error, "an agent was not announced again"),
        }
    }

    /// Stores the token of an agent in place of the previous one. Tokens are declared and
    /// undeclared outside the lock, because their callbacks may call this type again.
    fn replace_token(&self, agent: AgentId, incarnation: Incarnation, token: LivelinessToken) {
        let old = match self.lock().residents.get_mut(&(agent, incarnation)) {
            Some(held) => held.replace(token),
            // The agent has been withdrawn meanwhile.
            None => Some(token),
        };
        if let Some(old) = old {
            ZenohDeclaration::Token(old).undeclare();
        }
    }

    fn entities(
        self: &Arc<Self>,
        session: &Session,
        telling: u64,
    ) -> Result<Vec<ZenohDeclaration>, OpenError> {
        let (keys, security) = (&self.keys, self.security.as_ref());
        let mut entities = Vec::new();
        if let Some(security) = security {
            let subscriber = revocations::declare(session, keys, &self.inbound, security, telling)?;
            entities.push(ZenohDeclaration::Subscriber(subscriber));
        }
        let answering = QueryResponder {
            keys: keys.clone(),
            announced: announced_agents(self),
            known_sessions: self.known_sessions.clone(),
            inbound: Arc::clone(&self.inbound),
            security: security.cloned(),
        };
        entities.extend(answering.declare(session)?.map(ZenohDeclaration::Queryable));
        let heard = inbound::declare(session, keys, &self.inbound, security, telling)?;
        entities.extend(heard.into_iter().map(ZenohDeclaration::Subscriber));
        // The session token is declared last: a daemon that receives it can then send queries and
        // messages.
        let key_expr = keys.own_session(&session.zid().to_string(), telling);
        let token = session.liveliness().declare_token(&key_expr).wait();
        let token = token.map_err(|source| undeclared("liveliness", &key_expr, source))?;
        entities.push(ZenohDeclaration::Token(token));
        Ok(entities)
    }

    fn lock(&self) -> MutexGuard<'_, HeldDeclarations> {
        self.held.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

pub(crate) fn announced_agents(declarations: &Arc<Declarations>) -> Weak<dyn AnnouncedAgents> {
    let agents: Arc<dyn AnnouncedAgents> = Arc::<Declarations>::clone(declarations);
    Arc::downgrade(&agents)
}

impl AnnouncedAgents for Declarations {
    fn hosts(&self, agent: &AgentId) -> bool {
        let from = (agent.clone(), Incarnation::default());
        let held = self.lock();
        held.residents.range(from..).next().is_some_and(|((next, _), _)| next == agent)
    }

    fn has_announced(&self, agent: &AgentId, incarnation: Incarnation) -> bool {
        self.lock().residents.contains_key(&(agent.clone(), incarnation))
    }

    fn residents(&self) -> Vec<(AgentId, Incarnation)> {
        self.lock().residents.keys().cloned().collect()
    }
}

// === impl ZenohDeclaration ===

impl ZenohDeclaration {
    fn undeclare(self) {
        let undeclared = match self {
            ZenohDeclaration::Subscriber(subscriber) => subscriber.undeclare().wait(),
            ZenohDeclaration::Queryable(queryable) => queryable.undeclare().wait(),
            ZenohDeclaration::Token(token) => token.undeclare().wait(),
        };
        if let Err(error) = undeclared {
            tracing::debug!(%error, "a declaration ended with its session");
        }
    }
}
