//! Questions to other daemons and answers to their questions, by Zenoh's queries.
//!
//! Each daemon answers under a key of its own, and Zenoh's consolidation is off, because it would
//! keep only one of several answers under one key. In a secured ecosystem a question or a roll call
//! has a nonce, and the answer is signed together with the nonce.

use std::collections::BTreeSet;
use std::sync::{Arc, Weak};
use std::time::Duration;

use acl::{AgentId, DaemonId, Incarnation};
use bytes::Bytes;
use credentials::Nonce;
use substrate::memory::{ANSWERS_MAX, collect_answers};
use substrate::{BoxFuture, Inbound, ReceivedQuery, Resource, ResourceQuery};
use tokio::sync::mpsc;
use zenoh::bytes::ZBytes;
use zenoh::key_expr::KeyExpr;
use zenoh::qos::CongestionControl;
use zenoh::query::{ConsolidationMode, Parameters, Query, QueryTarget, Queryable, Reply, Selector};
use zenoh::sample::Sample;
use zenoh::{Session, Wait};

use crate::config::MESSAGE_PRIORITY;
use crate::inbound::into_bytes;
use crate::key_expr::{AGENT_PARAMETER, KeySpace};
use crate::known_sessions::{KnownSessions, SyncReply, SyncRequest};
use crate::open_error::{OpenError, undeclared};
use crate::sealing::{Security, UnverifiedAnswer, seal_answer};

/// Looks up the agents that a daemon has announced as present.
pub(crate) trait AnnouncedAgents: Send + Sync {
    /// Whether the daemon has announced an agent of this name.
    fn hosts(&self, agent: &AgentId) -> bool;

    /// Whether the daemon has announced this incarnation of an agent, and has not withdrawn it.
    fn has_announced(&self, agent: &AgentId, incarnation: Incarnation) -> bool;

    /// Returns the name and the incarnation of each agent that the daemon has announced, sorted by
    /// name.
    fn residents(&self) -> Vec<(AgentId, Incarnation)>;
}

/// Responder to the questions that come to one daemon.
#[derive(Clone)]
pub(crate) struct QueryResponder {
    pub(crate) keys: KeySpace,
    /// Weak reference, because the declarations hold the queryables that hold this responder.
    pub(crate) announced: Weak<dyn AnnouncedAgents>,
    pub(crate) known_sessions: KnownSessions,
    pub(crate) inbound: Arc<dyn Inbound>,
    pub(crate) security: Option<Security>,
}

/// Sender of questions in the name of one daemon.
#[derive(Clone)]
pub(crate) struct QuerySender {
    pub(crate) keys: KeySpace,
    pub(crate) inbound: Arc<dyn Inbound>,
    pub(crate) security: Option<Security>,
}

/// Sends a question. The returned future resolves to the answers that arrive within `timeout`.
///
/// The question is sent before this function returns. If no daemon can answer, the future resolves
/// to an empty list at once.
pub(crate) fn ask(
    session: &Session,
    asking: &QuerySender,
    ask: &ResourceQuery,
    timeout: Duration,
) -> BoxFuture<Vec<Bytes>> {
    let ResourceQuery { daemon, resource, agent } = ask;
    let key_expr = asking.keys.query(daemon.as_ref(), *resource, agent.as_ref());
    let parameters = match (resource, agent) {
        (Resource::Model, _) | (_, None) => Parameters::empty(),
        (_, Some(agent)) => Parameters::from(&[(AGENT_PARAMETER, agent.as_str())][..]),
    };
    let nonce = asking.nonce();
    let (answers, heard) = mpsc::channel(ANSWERS_MAX);
    let asking = asking.clone();
    let sent = session
        .get(Selector::owned(key_expr, parameters))
        .target(QueryTarget::All)
        .consolidation(ConsolidationMode::None)
        // A lost question is sent again; blocking would stop the sender for up to 5 s.
        .congestion_control(CongestionControl::Drop)
        .express(true)
        .timeout(timeout)
        .attachment(nonce.map(ZBytes::from))
        .callback(move |reply| asking.receive_answer(&answers, &reply, nonce.as_ref()))
        .wait();
    if let Err(error) = sent {
        tracing::debug!(%error, "a question was not asked");
    }
    Box::pin(collect_answers(heard, timeout))
}

// === impl QuerySender ===

impl QuerySender {
    /// Returns a nonce for one question; the answers are signed together with it. Returns `None` if
    /// the ecosystem is not secured, or if the system has no randomness. In a secured ecosystem, no
    /// answer to a question without a nonce is accepted.
    pub(crate) fn nonce(&self) -> Option<Nonce> {
        self.security.as_ref().and_then(|_| credentials::nonce())
    }

    /// Sends a roll call to all daemons or a probe to one, as the key expression selects.
    /// `hear` is called for each daemon that answers, with its answer if that is readable, and is
    /// dropped when no more answers will come. Returns `None` if the session is closed.
    ///
    /// An answer is handled as it arrives, and has the priority of messages: a broadcast that the
    /// same daemon sends after the answer must not be handled before it.
    pub(crate) fn call(
        &self,
        session: &Session,
        whom: KeyExpr<'static>,
        call: &SyncRequest,
        within: Duration,
        mut hear: impl FnMut(DaemonId, Option<SyncReply>) + Send + Sync + 'static,
    ) -> Option<()> {
        let (asking, nonce) = (self.clone(), self.nonce());
        let get = session.get(whom).target(QueryTarget::All).timeout(within);
        let get = get.attachment(nonce.map(ZBytes::from)).payload(call.write());
        let get =
            get.consolidation(ConsolidationMode::None).priority(MESSAGE_PRIORITY).express(true);
        let get = get.congestion_control(CongestionControl::Drop);
        let get = get.callback_mut(move |reply| {
            if let Some((daemon, reply)) = asking.reply(&reply, nonce.as_ref()) {
                hear(daemon, reply);
            }
        });
        get.wait().ok()
    }

    /// Returns the daemon that has answered a roll call or a probe, and its answer if that can be
    /// parsed. Returns `None` if the reply is an error, is not under the key of a probe, or has no
    /// valid signature in a secured ecosystem.
    fn reply(&self, reply: &Reply, nonce: Option<&Nonce>) -> Option<(DaemonId, Option<SyncReply>)> {
        let sample = reply.result().ok()?;
        let daemon = self.keys.reached(sample.key_expr().as_str())?;
        let payload = into_bytes(sample.payload());
        let answered = self.unverified(sample, &payload, nonce);
        let Some(security) = &self.security else {
            return Some((daemon, SyncReply::read(&payload)));
        };
        let answerer = security.answerer(&answered)?;
        let reply = SyncReply::read(&payload);
        if let Some(said) = reply.as_ref().and_then(|reply| reply.signed) {
            security.record_reply(answerer, said);
        }
        Some((daemon, reply))
    }

    fn unverified<'a>(
        &'a self,
        sample: &'a Sample,
        payload: &'a Bytes,
        nonce: Option<&'a Nonce>,
    ) -> UnverifiedAnswer<'a> {
        UnverifiedAnswer { keys: &self.keys, inbound: &*self.inbound, sample, payload, nonce }
    }

    fn receive_answer(&self, answers: &mpsc::Sender<Bytes>, reply: &Reply, nonce: Option<&Nonce>) {
        let sample = match reply.result() {
            Ok(sample) => sample,
            Err(error) => return tracing::debug!(?error, "a question ended with an error"),
        };
        let payload = into_bytes(sample.payload());
        let answered = self.unverified(sample, &payload, nonce);
        let admits = |security: &Security| security.admits(&answered);
        let is_admitted = self.security.as_ref().is_none_or(admits);
        if is_admitted && answers.try_send(payload).is_err() {
            tracing::debug!(key = sample.key_expr().as_str(), "an answer came too late");
        }
    }
}

// === impl QueryResponder ===

impl QueryResponder {
    /// Declares the queryables of a daemon.
    pub(crate) fn declare(self, session: &Session) -> Result<[Queryable<()>; 2], OpenError> {
        let of_models = self.clone();
        let (resources, models) = (self.keys.own_resources(), self.keys.own_models());
        Ok([
            declare(session, &resources, move |query| self.resources(&query))?,
            declare(session, &models, move |query| of_models.models(&query))?,
        ])
    }

    /// Answers a roll call or a probe. Passes on every other query for a resource; a query with a
    /// wildcard asks for several resources.
    fn resources(&self, query: &Query) {
        let probed = self.keys.reach(self.keys.daemon());
        if *query.key_expr() == probed || *query.key_expr() == self.keys.everyone_reached() {
            let call = query.payload().map(ZBytes::to_bytes).unwrap_or_default();
            let me = self.keys.daemon();
            let signed = self.security.as_ref().map(Security::said);
            let call = SyncRequest::read(&call);
            let answer =
                SyncReply::answer(self.residents(), &self.known_sessions, signed, (me, &call));
            reply(query, &probed, answer, self.security.as_ref());
            // A broadcast that waits for this call must not go out before the answer.
            return self.known_sessions.record_caller(&call);
        }
        let Ok(agent) = agent(query.parameters()) else {
            return tracing::debug!(selector = %query.selector(), "ignored a malformed question");
        };
        for resource in Resource::ALL {
            let key_expr = self.keys.at(resource);
            if query.key_expr().intersects(&key_expr) {
                self.question(query, resource, agent.clone(), key_expr);
            }
        }
    }

    /// Passes on a query for models: one question for each agent of this daemon that the query
    /// matches, so that each answer is under the key of its agent.
    fn models(&self, query: &Query) {
        if let Some(agent) = self.keys.asked_for(query.key_expr().as_str()) {
            // One lookup: with a thousand agents queried one by one, no query may search all of
            // them.
            if self.announced.upgrade().is_some_and(|each| each.hosts(&agent)) {
                let key_expr = self.keys.model(&agent);
                self.question(query, Resource::Model, Some(agent), key_expr);
            }
            return;
        }
        let agents: BTreeSet<_> = self.residents().into_iter().map(|(agent, _)| agent).collect();
        for agent in agents {
            let key_expr = self.keys.model(&agent);
            if query.key_expr().intersects(&key_expr) {
                self.question(query, Resource::Model, Some(agent), key_expr);
            }
        }
    }

    fn residents(&self) -> Vec<(AgentId, Incarnation)> {
        self.announced.upgrade().map_or_else(Vec::new, |each| each.residents())
    }

    fn question(
        &self,
        query: &Query,
        resource: Resource,
        agent: Option<AgentId>,
        key_expr: KeyExpr<'static>,
    ) {
        let (query, security) = (query.clone(), self.security.clone());
        let answer = Arc::new(move |payload| reply(&query, &key_expr, payload, security.as_ref()));
        self.inbound.receive_query(ReceivedQuery { resource, agent, answer });
    }
}

fn declare(
    session: &Session,
    key_expr: &KeyExpr<'static>,
    answer: impl Fn(Query) + Send + Sync + 'static,
) -> Result<Queryable<()>, OpenError> {
    let queryable = session.declare_queryable(key_expr).callback(answer);
    queryable.wait().map_err(|source| undeclared("queryable", key_expr, source))
}

fn reply(query: &Query, key_expr: &KeyExpr, payload: Bytes, security: Option<&Security>) {
    let seal = security.and_then(|Security { identity, .. }| {
        seal_answer(identity, key_expr.as_str(), &payload, query.attachment())
    });
    if let Err(error) = query.reply(key_expr, payload).attachment(seal).wait() {
        tracing::debug!(key = key_expr.as_str(), %error, "an answer was not sent");
    }
}

/// Returns the agent that a question is about; `None` if the question names none.
fn agent(parameters: &Parameters) -> Result<Option<AgentId>, acl::InvalidName> {
    parameters.get(AGENT_PARAMETER).map(AgentId::new).transpose()
}
