//! Upkeep of a Domain Maintainer: what an agent hears and sees, told to the state machine in
//! `capability`, and what changed, told to the agent.
//!
//! - Models and heartbeats come as `inform`s to all; a model that was missed is asked for.
//! - A lost token masks an agent's capabilities at once, and so do heartbeats that stop; when it
//!   stays away for [`Settings::removal`](crate::Settings), its objects and facts go too (design,
//!   “Presence”). Silence alone is enough, because a router can lose a token's end.
//! - What requests changed at the central maintainer comes with its announcements, for those who
//!   otherwise hear only heartbeats.
//!
//! The central Domain Maintainer lives by this upkeep; what actuators hear, the
//! [`Commons`](crate::Commons) of their daemon tell a maintainer in the same words.

use std::collections::BTreeMap;
use std::time::Duration;

use acl::content::{EpochChange, Heartbeat, Inform, ModelAnnouncement};
use acl::{AgentId, Incarnation, Message};
use capability::{
    Admission, Announcement, Beat, Change, Conflict, Declined, Maintainer, Moment, Requests,
    RequestsSince,
};
use pddl::Diagnostic;
use substrate::Presence;
use tokio::time::Instant;

use crate::base_agent::Agent;
use crate::context::{Context, TimerId, Work};

/// How long after models were composed the next are gathered before they are: those of a daemon that
/// starts come within this time, and a single one that comes is composed at once. Composing a
/// thousand takes some milliseconds.
const COMPOSING_APART: Duration = Duration::from_millis(20);

/// How long an agent that has just come is given to tell its model by itself: it does so at once, and
/// who asked all the same would be answered with what it knows.
pub(crate) const TELLING: Duration = Duration::from_millis(20);

/// How long before an agent that gave no answer is asked again for the first time, each time twice as
/// long as before, and how often: that it is here is known a moment before questions find their way to
/// it, and at most the tenth of a second after which Zenoh's routes are there. Who has no model is
/// asked in vain.
const ASK_AGAIN: Duration = Duration::from_millis(15);
const ASKED_AGAIN: u32 = 5;

/// How long a model that was not taken is neither asked for nor read again. Its agent says once a second
/// that it has it; what it lacked, like room among others, may be there after a while.
const REFUSED_FOR: Duration = Duration::from_secs(10);

/// Agents whose models were not taken, remembered at a time: as many as there may be with one.
const REFUSED_MAX: usize = capability::limits::AGENTS_MAX;

/// A maintainer, and what keeps it up to date.
pub struct Upkeep {
    /// The state machine.
    pub maintainer: Maintainer,
    began: Instant,
    expiry: Option<TimerId>,
    /// When models were composed last.
    composed: Option<Instant>,
    composing: Option<TimerId>,
    fetching: BTreeMap<AgentId, Work>,
    refused: Refused,
}

/// Models that were not taken lately: whose, of which life, which, and when.
#[derive(Default)]
pub(crate) struct Refused(BTreeMap<AgentId, (Incarnation, String, Moment)>);

/// An agent that keeps a maintainer.
pub trait Maintains: Agent {
    /// Its maintainer.
    fn upkeep(&mut self) -> &mut Upkeep;

    /// Something changed.
    fn changed(&mut self, _change: &Change, _ctx: &mut Context<Self>) {}

    /// Something of the model of `teller` cannot be composed as written.
    fn conflicted(&mut self, _conflicts: &[Conflict], _ctx: &mut Context<Self>) {}
}

impl Upkeep {
    /// Begins with what the maintainer knows already.
    pub fn new(maintainer: Maintainer) -> Upkeep {
        let (expiry, composed, composing) = (None, None, None);
        let (began, fetching) = (Instant::now(), BTreeMap::new());
        let refused = Refused::default();
        Upkeep { maintainer, began, expiry, composed, composing, fetching, refused }
    }

    /// Now, on the maintainer's clock.
    pub fn moment(&self) -> Moment {
        Moment(u64::try_from(self.began.elapsed().as_millis()).unwrap_or(u64::MAX))
    }
}

/// Takes an `inform` to all.
pub fn informed<A: Maintains>(agent: &mut A, message: &Message, ctx: &mut Context<A>) {
    let inform = match message.content_as::<Inform>() {
        Ok(inform) => inform,
        Err(error) => {
            tracing::info!(from = %message.sender, %error, "an inform that cannot be read");
            return;
        }
    };
    let mut read = None;
    if let Inform::Model(announced) = &inform {
        agent.upkeep().fetching.remove(&message.sender);
        let (sender, digest) = (&message.sender, &announced.heartbeat.digest);
        read = ctx.switchboard().announcement(sender, message.incarnation, digest);
    }
    let now = agent.upkeep().moment();
    let Upkeep { maintainer, refused, .. } = agent.upkeep();
    let heard = hear((maintainer, refused), message, &inform, read, now);
    compose_soon(agent, ctx);
    for change in &heard.changes {
        conclude(agent, change, ctx);
    }
    if heard.lacks_model {
        fetch(agent, &message.sender, ASKED_AGAIN, ctx);
    }
    // Where the commons listen, they have counted it.
    if let Some(why) = heard.not_taken()
        && !ctx.switchboard().has_commons()
    {
        ctx.switchboard().not_taken(message, why);
    }
    if let Some(mistake) = heard.mistake {
        ctx.not_understood(message, mistake);
    }
}

/// Composes the models that have come, or sees to it that it is done with those that come soon.
fn compose_soon<A: Maintains>(agent: &mut A, ctx: &mut Context<A>) {
    let upkeep = agent.upkeep();
    if !upkeep.maintainer.is_stale() || upkeep.composing.is_some() {
        return;
    }
    let over = upkeep.composed.map_or(COMPOSING_APART, |composed| composed.elapsed());
    let wait = COMPOSING_APART.saturating_sub(over);
    if wait.is_zero() {
        return compose(agent, ctx);
    }
    agent.upkeep().composing = Some(ctx.after(wait, |agent: &mut A, ctx| compose(agent, ctx)));
}

/// Composes the models that have come, if any: to be called before anybody is shown the domain.
pub fn compose<A: Maintains>(agent: &mut A, ctx: &mut Context<A>) {
    let upkeep = agent.upkeep();
    let timer = upkeep.composing.take();
    let (is_stale, now) = (upkeep.maintainer.is_stale(), upkeep.moment());
    if is_stale {
        let Admission { change, conflicts } = upkeep.maintainer.compose_taken(now);
        upkeep.composed = Some(Instant::now());
        if !conflicts.is_empty() {
            agent.conflicted(&conflicts, ctx);
        }
        conclude(agent, &change, ctx);
    }
    timer.into_iter().for_each(|timer| ctx.forget(timer));
}

/// What comes of an `inform` to all.
#[derive(Default)]
pub(crate) struct Heard {
    /// What changed.
    pub(crate) changes: Vec<Change>,
    /// Whether the sender's model has to be asked for first.
    pub(crate) lacks_model: bool,
    /// What the sender did not say as it should.
    pub(crate) mistake: Option<String>,
    /// Why what it said as it should is not believed, if it is not just late.
    declined: Option<String>,
}

/// Tells a maintainer an `inform` to all; `read` is what it announces, if that was read before.
pub(crate) fn hear(
    (maintainer, refused): (&mut Maintainer, &mut Refused),
    message: &Message,
    inform: &Inform,
    read: Option<Announcement>,
    now: Moment,
) -> Heard {
    let mut heard = Heard::default();
    match inform {
        Inform::Model(announced) => {
            let digest = &announced.heartbeat.digest;
            if refused.has(message, digest, now) {
                return heard;
            }
            if heard.admit(maintainer, message, announced, read, now) {
                refused.0.remove(&message.sender);
                heard.believe(maintainer, message, &announced.heartbeat, now);
            } else {
                refused.note(message, digest, now);
            }
        }
        Inform::Heartbeat(beat) => {
            let needs_model = maintainer.needs_model(&message.sender, &beat.digest);
            heard.lacks_model = needs_model && !refused.has(message, &beat.digest, now);
            if !needs_model {
                heard.believe(maintainer, message, beat, now);
            }
        }
        Inform::Epoch(change) => heard.follow(maintainer, message, change, now),
        Inform::Answer(_) => (),
    }
    heard
}

/// Takes a change of presence.
pub fn presence<A: Maintains>(agent: &mut A, presence: &Presence, ctx: &mut Context<A>) {
    let (who, life) = (presence.resident().agent.clone(), presence.resident().incarnation);
    let now = agent.upkeep().moment();
    let change = match presence {
        Presence::Joined(_) => {
            // Who is back may have said something while it was away.
            if agent.upkeep().maintainer.is_masked(&who) {
                fetch(agent, &who, ASKED_AGAIN, ctx);
            }
            let whose = who.clone();
            ctx.after(TELLING, move |agent: &mut A, ctx| {
                if agent.upkeep().maintainer.incarnation(&whose) != Some(life) {
                    fetch(agent, &whose, ASKED_AGAIN, ctx);
                }
            });
            agent.upkeep().maintainer.unmask(&who, life, now)
        }
        Presence::Left(_) => {
            agent.upkeep().fetching.remove(&who);
            agent.upkeep().maintainer.mask(&who, life, now)
        }
    };
    conclude(agent, &change, ctx);
}

/// Tells the agent what changed, and sees to it that what expires does so in time. To be called
/// after any change of the maintainer.
pub fn conclude<A: Maintains>(agent: &mut A, change: &Change, ctx: &mut Context<A>) {
    if let Some(earlier) = agent.upkeep().expiry.take() {
        ctx.forget(earlier);
    }
    if let Some(next) = agent.upkeep().maintainer.next_expiry() {
        // A millisecond more, because a moment is a whole number of them.
        let wait = next.since(agent.upkeep().moment()) + Duration::from_millis(1);
        agent.upkeep().expiry = Some(ctx.after(wait, expire));
    }
    for gone in &change.left {
        let Some(life) = agent.upkeep().maintainer.incarnation(gone) else { continue };
        let (gone, removal) = (gone.clone(), ctx.settings().removal);
        ctx.after(removal, move |agent: &mut A, ctx| remove(agent, &gone, life, ctx));
    }
    if !change.is_empty() {
        agent.changed(change, ctx);
    }
}

fn expire<A: Maintains>(agent: &mut A, ctx: &mut Context<A>) {
    let now = agent.upkeep().moment();
    let change = agent.upkeep().maintainer.expire(now);
    conclude(agent, &change, ctx);
}

fn remove<A: Maintains>(agent: &mut A, gone: &AgentId, life: Incarnation, ctx: &mut Context<A>) {
    if agent.upkeep().maintainer.is_present(gone) {
        return;
    }
    let now = agent.upkeep().moment();
    let change = agent.upkeep().maintainer.remove(gone, life, now);
    conclude(agent, &change, ctx);
}

impl Refused {
    fn has(&self, message: &Message, digest: &str, now: Moment) -> bool {
        self.0.get(&message.sender).is_some_and(|(life, refused, at)| {
            *life == message.incarnation && refused == digest && now.since(*at) < REFUSED_FOR
        })
    }

    fn note(&mut self, message: &Message, digest: &str, now: Moment) {
        if self.0.len() >= REFUSED_MAX {
            self.0.retain(|_, (.., at)| now.since(*at) < REFUSED_FOR);
        }
        if self.0.len() < REFUSED_MAX {
            let refused = (message.incarnation, digest.to_owned(), now);
            self.0.insert(message.sender.clone(), refused);
        }
    }
}

impl Heard {
    /// Why what the sender said of itself is not taken, if it is not.
    pub(crate) fn not_taken(&self) -> Option<&str> {
        self.mistake.as_deref().or(self.declined.as_deref())
    }

    /// Takes a model; `false` if it is not taken.
    fn admit(
        &mut self,
        maintainer: &mut Maintainer,
        message: &Message,
        announced: &ModelAnnouncement,
        read: Option<Announcement>,
        now: Moment,
    ) -> bool {
        let sender = &message.sender;
        let read_now = || Announcement::read(sender.clone(), message.incarnation, announced);
        let announcement = read.map_or_else(read_now, Ok);
        let admitted = announcement.map_err(|diagnostics| {
            let located = |diagnostic: &Diagnostic| diagnostic.located(&announced.model);
            diagnostics.iter().map(located).collect::<Vec<_>>().join("; ")
        });
        let admitted = admitted.and_then(|announcement| {
            maintainer.take(announcement, now).map_err(|declined| declined.to_string())
        });
        match admitted {
            Ok(()) => true,
            Err(mistake) => {
                tracing::debug!(from = %sender, mistake, "an action model is not taken");
                self.mistake = Some(mistake);
                false
            }
        }
    }

    fn believe(
        &mut self,
        maintainer: &mut Maintainer,
        message: &Message,
        heartbeat: &Heartbeat,
        now: Moment,
    ) {
        let (sender, life) = (message.sender.clone(), message.incarnation);
        match Beat::read(sender, life, heartbeat, now) {
            Ok(beat) => match maintainer.believe_heartbeat(beat, now) {
                Ok(change) => self.changes.push(change),
                Err(declined) => {
                    tracing::debug!(from = %message.sender, %declined, "a heartbeat is not believed");
                    // On a restart, and where messages overtake each other, some come too late.
                    let is_late = matches!(
                        declined,
                        Declined::OldSequence { .. }
                            | Declined::FormerIncarnation { .. }
                            | Declined::UnknownAgent { .. }
                    );
                    self.declined = (!is_late).then(|| declined.to_string());
                }
            },
            Err(diagnostics) => self.mistake = Some(joined(&diagnostics)),
        }
    }

    /// Takes what a central maintainer tells of requests; everything else in its announcement is
    /// heard here from those whose word it is.
    fn follow(
        &mut self,
        maintainer: &mut Maintainer,
        message: &Message,
        change: &EpochChange,
        now: Moment,
    ) {
        // Who has an action model is no Domain Maintainer, whatever it says of others.
        if !maintainer.follows() || maintainer.incarnation(&message.sender).is_some() {
            return;
        }
        let EpochChange { requested, requested_since, .. } = change;
        if let Some(told) = requested {
            let read = Requests::read(told, now);
            self.followed(message, read.map(|requests| maintainer.follow(&requests, now)));
        }
        if let Some(told) = requested_since {
            let read = RequestsSince::read(told, now);
            self.followed(message, read.map(|since| maintainer.follow_since(&since, now)));
        }
    }

    fn followed(
        &mut self,
        message: &Message,
        followed: Result<Result<Change, Declined>, Vec<Diagnostic>>,
    ) {
        match followed {
            Ok(Ok(change)) => self.changes.push(change),
            Ok(Err(declined)) => {
                tracing::warn!(from = %message.sender, %declined, "requests are not applied");
            }
            Err(diagnostics) => self.mistake = Some(joined(&diagnostics)),
        }
    }
}

fn joined(diagnostics: &[Diagnostic]) -> String {
    diagnostics.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ")
}

/// Asks an agent for its model. Reasoning agents have none and do not answer.
fn fetch<A: Maintains>(agent: &mut A, whose: &AgentId, again: u32, ctx: &mut Context<A>) {
    if agent.upkeep().fetching.contains_key(whose) {
        return;
    }
    let Some(resident) = ctx.find(whose) else { return };
    let asked = ctx.switchboard().model_of(resident);
    let name = whose.clone();
    let work = ctx.run(asked, move |agent: &mut A, answers, ctx| {
        agent.upkeep().fetching.remove(&name);
        if answers.is_empty() && again > 0 && agent.upkeep().maintainer.incarnation(&name).is_none()
        {
            let wait = ASK_AGAIN * (1 << ASKED_AGAIN.saturating_sub(again));
            ctx.after(wait, move |agent: &mut A, ctx| fetch(agent, &name, again - 1, ctx));
            return;
        }
        for answer in answers {
            match acl::decode(&answer) {
                Ok(message) if message.sender == name => informed(agent, &message, ctx),
                _ => tracing::info!(from = %name, "an answer that is no model"),
            }
        }
    });
    agent.upkeep().fetching.insert(whose.clone(), work);
}
