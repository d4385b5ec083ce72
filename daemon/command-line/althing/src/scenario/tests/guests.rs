//! Test agents that are not part of the building, and that do not do what they announce.

use std::time::Duration;

use acl::content::{
    Agreement, Bid, CallForProposals, Heartbeat, Inform, Method, ModelAnnouncement, Proposal,
    Reason, Request,
};
use acl::{AgentId, Message, Millis, Performative};
use agent::{Agent, Callbacks, Context, Participation};
use capability::model_digest;

use crate::hosting::DaemonNode;

/// The behaviour of a guest when it is asked to act.
#[derive(Clone, Copy, PartialEq)]
enum Conduct {
    Refuses,
    IsSilent,
    AgreesAndIsSilent,
    HasABrokenModel,
}

pub(super) fn one_that_refuses(node: &DaemonNode) {
    enter(node, Conduct::Refuses);
}

pub(super) fn one_that_is_silent(node: &DaemonNode) {
    enter(node, Conduct::IsSilent);
}

pub(super) fn one_that_agrees_and_is_silent(node: &DaemonNode) {
    enter(node, Conduct::AgreesAndIsSilent);
}

pub(super) fn one_with_a_broken_model(node: &DaemonNode) {
    enter(node, Conduct::HasABrokenModel);
}

const MODEL: &str = "(define (agent guest) (:domain smart-office)
    (:objects guest - temperature-sensor)
    (:init (located guest office1))
    (:action report-temperature :agent ?s - temperature-sensor :parameters (?r - room)
        :precondition (located ?s ?r)
        :effect (and (known-temperature ?r) (increase (total-cost) 1))))";

fn enter(node: &DaemonNode, conduct: Conduct) {
    let id = AgentId::new("guest").expect("a name");
    node.launch(id, Guest { conduct, beats: 0 }, "smart-office");
}

/// An agent that announces that it can measure the temperature in office1.
struct Guest {
    conduct: Conduct,
    beats: u64,
}

impl Agent for Guest {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new()
            .on(Performative::Request, Self::requested)
            .on(Performative::Cancel, |_, _, _| ())
            .on(Performative::AcceptProposal, |_, _, _| ())
            .on(Performative::RejectProposal, |_, _, _| ())
            .on(Performative::NotUnderstood, |_, _, _| ())
            .on(Performative::Cfp, Self::called)
            .on_broadcast(Performative::Cfp, Self::called)
    }

    fn activated(&mut self, ctx: &mut Context<Self>) {
        self.beat(ctx);
    }
}

impl Guest {
    fn beat(&mut self, ctx: &mut Context<Self>) {
        self.beats += 1;
        let broken = self.conduct == Conduct::HasABrokenModel;
        let model = if broken { "(define (agent guest) (:action" } else { MODEL };
        let method = Method {
            method: "read_temperature".to_owned(),
            arguments: [].into(),
            timeout: Millis(Duration::from_secs(2)),
        };
        let methods = [("report-temperature".to_owned(), method)].into();
        let heartbeat = Heartbeat {
            digest: model_digest(model, &methods),
            sequence: self.beats,
            facts: "(located guest office1)".to_owned(),
            known_for: [].into(),
            period: Millis(Duration::from_secs(1)),
            stops: Vec::new(),
        };
        let model = model.to_owned();
        ctx.broadcast_state(&Inform::Model(Box::new(ModelAnnouncement {
            model,
            methods,
            heartbeat,
        })));
        ctx.after(Duration::from_secs(1), |guest: &mut Self, ctx| guest.beat(ctx));
    }

    fn called(&mut self, message: Message, ctx: &mut Context<Self>) {
        let call: CallForProposals = message.content_as().expect("a call");
        let participation = Participation::of(&message);
        let wanted = "(known-temperature office1)".to_owned();
        if !call.conjuncts.contains(&wanted) {
            return ctx.refuse(&participation, Reason::Incapable, "not mine");
        }
        let proposal = Proposal {
            covers: vec![wanted],
            plan: "(report-temperature guest office1)\n".to_owned(),
            cost: 1.0,
        };
        let bid = Bid { proposals: vec![proposal], ..Bid::default() };
        ctx.answer(&participation, Performative::Agree, &bid);
    }

    fn requested(&mut self, message: Message, ctx: &mut Context<Self>) {
        let participation = Participation::of(&message);
        match self.conduct {
            Conduct::Refuses => ctx.refuse(&participation, Reason::Incapable, "I only say so"),
            Conduct::AgreesAndIsSilent => {
                let Ok(Request::Act(act)) = message.content_as() else { return };
                let agreement = Agreement { token: act.token, has_begun: false };
                ctx.answer(&participation, Performative::Agree, &agreement);
            }
            Conduct::IsSilent | Conduct::HasABrokenModel => (),
        }
    }
}
