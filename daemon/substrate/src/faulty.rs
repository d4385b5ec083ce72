//! A substrate within one process whose links are bad: what is sent may be lost, doubled, late or
//! overtaken, links break and are mended, processes die. What happens is decided by a seed alone,
//! as long as one thread does everything and time is simulated.
//!
//! - A link that breaks loses what is sent over it at once; that somebody is gone is seen when its
//!   lease has passed, as on a real network, or at once where the connection was reset.
//! - What a daemon says to itself never leaves the process, and is never lost.
//! - A daemon that reads slowly hears everything late, and no more than [`UNDER_WAY_MAX`] messages wait
//!   for it.

mod wire;

use std::collections::BTreeSet;
use std::ops::Range;
use std::sync::{Arc, Mutex, PoisonError, Weak};
use std::time::Duration;

use acl::{AgentId, DaemonId, Incarnation, Performative};
use bytes::Bytes;
use tokio::sync::{Notify, mpsc};
use tokio::time::Instant;

use self::wire::{Coming, Connected, Island, Target, Wire};
use crate::memory::{ANSWERS_MAX, collect_answers};
use crate::{
    Address, Addressed, Ask, BoxFuture, Delivery, Inbound, PresenceToken, Question, SendError,
    Subject, Substrate,
};

/// Messages under way to one daemon; more are lost, as a wire that must not wait loses them.
pub const UNDER_WAY_MAX: usize = 20_000;

/// How bad links are.
#[derive(Clone, Debug, PartialEq)]
pub struct Weather {
    /// Which share of messages is lost.
    pub loss: f64,
    /// Which share comes twice.
    pub doubled: f64,
    /// Which share is overtaken by what was sent later.
    pub overtaken: f64,
    /// How long a message is under way, in microseconds.
    pub delay: Range<u64>,
}

/// One ecosystem's wire. Clones are the same wire.
#[derive(Clone)]
pub struct Network(Arc<Shared>);

struct Shared {
    wire: Mutex<Wire>,
    /// Something is due earlier than was known.
    sooner: Notify,
}

/// Names a cut.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Cut(u64);

/// A stranger that hears everything that is sent, from whom.
type Tap = Arc<dyn Fn(&DaemonId, &Addressed, &Bytes) + Send + Sync>;

/// What happened to messages so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Told {
    /// Handed over.
    pub sent: u64,
    /// Never came, because of the weather or because too much was under way.
    pub lost: u64,
    /// Never came, because a link was broken.
    pub cut: u64,
    /// Came twice.
    pub doubled: u64,
    /// Came after what was sent later.
    pub overtaken: u64,
    /// Took longer than anything does in fair weather.
    pub delayed: u64,
    /// Came late, because its receiver reads slowly.
    pub slowed: u64,
}

/// One daemon's end of the wire.
struct Port {
    target: Target,
    shared: Weak<Shared>,
}

// === impl Weather ===

impl Weather {
    /// Links as they are in a house: nothing is lost, everything takes a moment.
    pub fn fair() -> Weather {
        Weather { loss: 0.0, doubled: 0.0, overtaken: 0.0, delay: 100..2_000 }
    }
}

// === impl Network ===

impl Network {
    /// A wire with nobody on it, in fair weather. What is on its way is delivered by a task of the
    /// runtime that this is called in.
    pub fn new(seed: u64) -> Network {
        let shared = Arc::new(Shared { wire: Mutex::new(Wire::new(seed)), sooner: Notify::new() });
        tokio::spawn(carry(Arc::downgrade(&shared)));
        Network(shared)
    }

    /// Connects a daemon.
    pub fn open(&self, daemon: DaemonId, inbound: Arc<dyn Inbound>) -> Arc<dyn Substrate> {
        let life = self.0.with(|wire| {
            wire.lives_count += 1;
            let life = wire.lives_count;
            let connected = Connected { inbound, life, sees: BTreeSet::new(), under_way: 0 };
            wire.daemons.insert(daemon.clone(), connected);
            wire.look(&daemon);
            life
        });
        Arc::new(Port { target: Target { daemon, life }, shared: Arc::downgrade(&self.0) })
    }

    /// Takes a daemon off the wire as a SIGKILL of its process would: what was under way to it is
    /// gone, and the others see at once that its agents are.
    pub fn kill(&self, daemon: &DaemonId) {
        self.0.with(|wire| {
            wire.daemons.remove(daemon);
            wire.residents.retain(|(_, host), _| host != daemon);
            wire.look_all();
        });
    }

    /// Breaks the links between these daemons and all others; the ends see it after `lease`.
    pub fn cut(&self, daemons: BTreeSet<DaemonId>, lease: Duration) -> Cut {
        self.0.with(|wire| {
            wire.cuts_count += 1;
            let cut = Cut(wire.cuts_count);
            let lease = Instant::now() + lease;
            wire.cuts.insert(cut, Island { daemons, lease, stopped: 0 });
            let ends: Vec<_> = wire.daemons.keys().cloned().collect();
            ends.iter().for_each(|end| wire.happens(lease, end, Coming::Look));
            cut
        })
    }

    /// Mends the links that a cut broke, but for those that another did too; how many messages that
    /// cut has stopped.
    pub fn mend(&self, cut: Cut) -> u64 {
        self.0.with(|wire| {
            let stopped = wire.cuts.remove(&cut).map_or(0, |island| island.stopped);
            wire.look_all();
            stopped
        })
    }

    /// Lets a daemon hear everything so much later.
    pub fn slow(&self, daemon: &DaemonId, by: Duration) {
        self.0.with(|wire| {
            if by.is_zero() {
                wire.slow.remove(daemon)
            } else {
                wire.slow.insert(daemon.clone(), by)
            }
        });
    }

    /// Changes how bad all links are.
    pub fn weather(&self, weather: Weather) {
        self.0.with(|wire| wire.weather = weather);
    }

    /// Lets `tap` hear everything that is sent from now on, also what is lost.
    pub fn tap(&self, tap: impl Fn(&DaemonId, &Addressed, &Bytes) + Send + Sync + 'static) {
        self.0.with(|wire| wire.tap = Some(Arc::new(tap)));
    }

    /// What happened to messages so far.
    pub fn told(&self) -> Told {
        self.0.with(|wire| wire.told)
    }
}

/// Delivers what is due, when it is, for as long as the wire is held by anybody.
async fn carry(shared: Weak<Shared>) {
    loop {
        let Some(held) = shared.upgrade() else { return };
        let next = held.with(|wire| wire.due.keys().next().map(|(due, _)| *due));
        let sooner = held.sooner.notified();
        match next {
            Some(due) if due > Instant::now() => {
                // A wait has a bound, so that a wire that nobody holds any more is let go of.
                tokio::select! {
                    biased;
                    () = sooner => (),
                    () = tokio::time::sleep_until(due) => (),
                }
            }
            Some(_) => held.deliver_next(),
            None => {
                let _ = tokio::time::timeout(Duration::from_secs(1), sooner).await;
            }
        }
    }
}

// === impl Shared ===

impl Shared {
    fn with<T>(&self, act: impl FnOnce(&mut Wire) -> T) -> T {
        let mut wire = self.wire.lock().unwrap_or_else(PoisonError::into_inner);
        let first = wire.due.keys().next().copied();
        let acted = act(&mut wire);
        if wire.due.keys().next().copied() != first {
            self.sooner.notify_one();
        }
        acted
    }

    fn deliver_next(self: &Arc<Self>) {
        let (inbound, coming) = {
            let mut wire = self.wire.lock().unwrap_or_else(PoisonError::into_inner);
            let Some((_, (target, coming))) = wire.due.pop_first() else { return };
            let Some(connected) = wire.daemons.get_mut(&target.daemon) else { return };
            if connected.life != target.life {
                return;
            }
            connected.under_way = connected.under_way.saturating_sub(1);
            if let Coming::Look = coming {
                return wire.look(&target.daemon);
            }
            (Arc::clone(&connected.inbound), coming)
        };
        // The lock is gone: a receiver may answer at once.
        match coming {
            Coming::Message(delivery) => inbound.deliver(delivery),
            Coming::Presence(presence) => inbound.presence(presence),
            Coming::Question(question) => inbound.question(question),
            Coming::Answer(answers, payload) => drop(answers.try_send(payload)),
            Coming::Nothing(_) | Coming::Look => (),
        }
    }
}

// === impl Port ===

impl Port {
    /// Runs `act` on the wire if this life of the daemon is still on it.
    fn with<T>(&self, act: impl FnOnce(&mut Wire) -> T) -> Result<T, SendError> {
        let shared = self.shared.upgrade().ok_or(SendError::Closed)?;
        shared.with(|wire| {
            let connected = wire.daemons.get(&self.target.daemon);
            match connected.is_some_and(|connected| connected.life == self.target.life) {
                true => Ok(act(wire)),
                false => Err(SendError::Closed),
            }
        })
    }

    fn say(
        &self,
        addressed: Addressed,
        payload: Bytes,
        to: Option<&DaemonId>,
    ) -> Result<(), SendError> {
        let from = &self.target.daemon;
        let tap = self.with(|wire| {
            let to: Vec<_> = match to {
                Some(to) => vec![to.clone()],
                None => wire.daemons.keys().cloned().collect(),
            };
            for to in to {
                let (addressed, payload) = (addressed.clone(), payload.clone());
                let delivery = Delivery { addressed, payload, origin: None };
                let _ = wire.send(from, &to, Coming::Message(delivery));
            }
            wire.tap.clone()
        })?;
        if let Some(tap) = tap {
            tap(from, &addressed, &payload);
        }
        Ok(())
    }
}

impl Substrate for Port {
    fn send(&self, to: &Address, subject: Subject, payload: Bytes) -> Result<(), SendError> {
        self.say(Addressed::To(to.agent.clone(), subject), payload, Some(&to.daemon))
    }

    fn broadcast(
        &self,
        sender: &AgentId,
        performative: Performative,
        payload: Bytes,
    ) -> Result<(), SendError> {
        self.say(Addressed::All(sender.clone(), performative), payload, None)
    }

    fn beat(&self, sender: &AgentId, payload: Bytes) -> Result<(), SendError> {
        self.say(Addressed::Beat(sender.clone()), payload, None)
    }

    fn announce(
        &self,
        agent: &AgentId,
        incarnation: Incarnation,
    ) -> Result<PresenceToken, SendError> {
        let key = (agent.clone(), self.target.daemon.clone());
        self.with(|wire| {
            wire.residents.insert(key.clone(), incarnation);
            wire.look_all();
        })?;
        let shared = Weak::clone(&self.shared);
        Ok(PresenceToken::new(move || {
            let Some(shared) = shared.upgrade() else { return };
            shared.with(|wire| {
                if wire.residents.get(&key) == Some(&incarnation) {
                    wire.residents.remove(&key);
                    wire.look_all();
                }
            });
        }))
    }

    fn ask(&self, ask: Ask, timeout: Duration) -> BoxFuture<Vec<Bytes>> {
        let (answers, heard) = mpsc::channel(ANSWERS_MAX);
        let asker = self.target.clone();
        let shared = Weak::clone(&self.shared);
        let _ = self.with(|wire| {
            let asked: Vec<_> = match &ask.daemon {
                Some(daemon) => vec![daemon.clone()],
                None => wire.daemons.keys().cloned().collect(),
            };
            for daemon in asked {
                if !wire.daemons.contains_key(&daemon) {
                    continue;
                }
                let (from, shared, asker) = (daemon.clone(), Weak::clone(&shared), asker.clone());
                let back = answers.clone();
                let answer = Arc::new(move |payload| {
                    bring_back(&shared, &from, &asker, back.clone(), payload, timeout);
                });
                let Ask { resource, ref agent, .. } = ask;
                let question = Question { resource, agent: agent.clone(), answer };
                if wire.send(&self.target.daemon, &daemon, Coming::Question(question)).is_err() {
                    let nothing = Coming::Nothing(answers.clone());
                    wire.happens(Instant::now() + timeout, &self.target.daemon, nothing);
                }
            }
        });
        drop(answers);
        Box::pin(collect_answers(heard, timeout))
    }

    fn close(&self) -> BoxFuture<()> {
        if let Some(shared) = self.shared.upgrade()
            && self.with(|_| ()).is_ok()
        {
            Network(shared).kill(&self.target.daemon);
        }
        Box::pin(std::future::ready(()))
    }
}

/// Sends an answer to who asked; one that is lost is waited for.
fn bring_back(
    shared: &Weak<Shared>,
    from: &DaemonId,
    asker: &Target,
    answers: mpsc::Sender<Bytes>,
    payload: Bytes,
    timeout: Duration,
) {
    let Some(shared) = shared.upgrade() else { return };
    shared.with(|wire| {
        let answer = Coming::Answer(answers, payload);
        if let Err(Coming::Answer(answers, _)) = wire.send(from, &asker.daemon, answer) {
            wire.happens(Instant::now() + timeout, &asker.daemon, Coming::Nothing(answers));
        }
    });
}

#[cfg(test)]
mod tests;
