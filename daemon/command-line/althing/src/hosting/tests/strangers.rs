//! Test agents that do what the test sets, whatever their action models declare.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use acl::content::{
    Act, Agreement, Bid, CallForProposals, Heartbeat, Inform, Method, ModelAnnouncement, Outcome,
    Proposal, Reason, Report, Request,
};
use acl::{AgentId, Message, Millis, Performative};
use agent::{Agent, Callbacks, Context, Participation};
use capability::model_digest;

use super::Office;

/// The behaviour of a test agent when it is asked to act.
#[derive(Clone, Copy)]
pub(super) enum Conduct {
    /// Refuses each request, with this reason.
    Refuses(Reason),
    /// Refuses this many requests, with this reason, and confirms all later ones.
    RefusesAtFirst(usize, Reason),
    /// Agrees to the request, and sends nothing more.
    FallsSilent,
    /// Confirms the request after this time, whether or not it has done anything.
    Confirms(Duration),
}

/// The declarations and the behaviour of a test agent.
pub(super) struct Script {
    /// The action model of the test agent, without its head.
    pub(super) model: String,
    /// The facts in the heartbeats of the test agent.
    pub(super) facts: String,
    pub(super) conduct: Conduct,
    /// The proposals of the test agent, each for one conjunct: the conjunct, the plan, and the
    /// cost.
    pub(super) offers: Vec<(String, String, f64)>,
    /// The actions that the test agent has been asked for.
    pub(super) asked: Vec<String>,
}

/// A handle by which a test changes a running test agent and reads what it has been asked for.
#[derive(Clone)]
pub(super) struct Stranger(Arc<Mutex<Script>>);

impl Stranger {
    /// Launches a test agent and waits until all agents know it.
    pub(super) async fn enter(office: &Office, name: &str, script: Script) -> Stranger {
        let stranger = Stranger(Arc::new(Mutex::new(script)));
        let id = AgentId::new(name).expect("a name");
        let agent = Body { script: stranger.clone(), beats: 0 };
        office.node.launch(id, agent, office.ecosystem.domain.name.as_str());
        tokio::time::sleep(Duration::from_millis(200)).await;
        stranger
    }

    /// Reads or changes the script of the test agent.
    pub(super) fn script<T>(&self, look: impl FnOnce(&mut Script) -> T) -> T {
        look(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// Returns the names of the actions that the test agent has been asked for.
    pub(super) fn asked(&self) -> Vec<String> {
        let name = |action: &String| {
            let inner = action.trim_start_matches('(');
            inner.split(' ').next().unwrap_or_default().to_owned()
        };
        self.script(|script| script.asked.iter().map(name).collect())
    }
}

struct Body {
    script: Stranger,
    beats: u64,
}

impl Agent for Body {
    fn callbacks(&self) -> Callbacks<Self> {
        let nothing = |_: &mut Self, _: Message, _: &mut Context<Self>| ();
        Callbacks::new()
            .on(Performative::Request, Self::requested)
            .on(Performative::Cfp, Self::called)
            .on(Performative::Cancel, Self::cancelled)
            .on(Performative::AcceptProposal, nothing)
            .on(Performative::RejectProposal, nothing)
            .on(Performative::NotUnderstood, nothing)
            .on(Performative::Refuse, nothing)
            .on_broadcast(Performative::Cfp, Self::called)
    }

    fn activated(&mut self, ctx: &mut Context<Self>) {
        self.beat(ctx);
    }
}

impl Body {
    fn beat(&mut self, ctx: &mut Context<Self>) {
        self.beats += 1;
        let (model, facts) =
            self.script.script(|script| (script.model.clone(), script.facts.clone()));
        let model = format!("(define (agent {}) (:domain smart-office) {model})", ctx.id());
        let read = pddl::parse_action_model(&model).into_result().expect("a model");
        let method = |name: &str| Method {
            method: name.to_owned(),
            arguments: [].into(),
            timeout: Millis(Duration::from_secs(20)),
        };
        let actions = read.actions.iter().map(|action| action.name.as_str());
        let methods = actions.map(|name| (name.to_owned(), method(name))).collect();
        let heartbeat = Heartbeat {
            digest: model_digest(&model, &methods),
            sequence: self.beats,
            facts,
            known_for: [].into(),
            period: Millis(Duration::from_secs(1)),
            stops: Vec::new(),
        };
        ctx.broadcast_state(&Inform::Model(Box::new(ModelAnnouncement {
            model,
            methods,
            heartbeat,
        })));
        ctx.after(Duration::from_secs(1), |body: &mut Self, ctx| body.beat(ctx));
    }

    fn called(&mut self, message: Message, ctx: &mut Context<Self>) {
        let call: CallForProposals = message.content_as().expect("a call");
        let participation = Participation::of(&message);
        let offers = self.script.script(|script| script.offers.clone());
        let mine = offers.into_iter().filter(|(conjunct, ..)| call.conjuncts.contains(conjunct));
        let proposal = |(conjunct, plan, cost)| Proposal { covers: vec![conjunct], plan, cost };
        let proposals: Vec<_> = mine.map(proposal).collect();
        if proposals.is_empty() {
            return ctx.refuse(&participation, Reason::Incapable, "not mine");
        }
        let bid = Bid { proposals, ..Bid::default() };
        ctx.answer(&participation, Performative::Agree, &bid);
    }

    fn requested(&mut self, message: Message, ctx: &mut Context<Self>) {
        let participation = Participation::of(&message);
        let Ok(Request::Act(act)) = message.content_as() else { return };
        let (conduct, before) = self.script.script(|script| {
            script.asked.push(act.action.clone());
            (script.conduct, script.asked.len() - 1)
        });
        match conduct {
            Conduct::Refuses(reason) => ctx.refuse(&participation, reason, "I only say so"),
            Conduct::RefusesAtFirst(times, reason) if before < times => {
                ctx.refuse(&participation, reason, "my mailbox is full");
            }
            Conduct::RefusesAtFirst(..) => self.confirm(participation, *act, Duration::ZERO, ctx),
            Conduct::FallsSilent => {
                ctx.answer(
                    &participation,
                    Performative::Agree,
                    &Agreement { token: act.token, has_begun: false },
                );
            }
            Conduct::Confirms(after) => self.confirm(participation, *act, after, ctx),
        }
    }

    fn confirm(
        &mut self,
        participation: Participation,
        act: Act,
        after: Duration,
        ctx: &mut Context<Self>,
    ) {
        ctx.answer(
            &participation,
            Performative::Agree,
            &Agreement { token: act.token, has_begun: false },
        );
        ctx.after(after, move |_: &mut Self, ctx| {
            let report = Report::new(Outcome::Done, "so it is");
            let report = Report { action: Some(act.action), ..report };
            ctx.answer(&participation, Performative::Confirm, &report);
        });
    }

    fn cancelled(&mut self, message: Message, ctx: &mut Context<Self>) {
        let report = Report::new(Outcome::Cancelled, "given up as asked");
        ctx.answer(&Participation::of(&message), Performative::Confirm, &report);
    }
}
