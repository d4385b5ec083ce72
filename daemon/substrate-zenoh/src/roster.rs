//! Who says to be here, whom of them a call has reached, and what of both was passed on.
//!
//! A token alone is not enough. It may come before the route to its daemon; and a router that has
//! not yet noticed a death may tell of the dead again, to others who had taken note of it and then
//! are never told otherwise. So nobody joins before its daemon has answered, whoever the daemon
//! does not host is no longer here, and neither is who belongs to a daemon that does not answer for
//! a lease.

use std::collections::{BTreeMap, BTreeSet};
use std::time::{Duration, Instant};

use acl::{AgentId, DaemonId, Incarnation};
use substrate::{Presence, Resident};

/// Tokens and answers of all daemons, and what follows from them.
///
/// What its methods return is to be passed on in this order.
#[derive(Debug)]
pub(crate) struct Roster {
    own: DaemonId,
    /// How long a daemon may be silent.
    lease: Duration,
    /// Counts tokens as they come, so that an answer is not held against one that came later.
    tokens: u64,
    daemons: BTreeMap<DaemonId, Hosted>,
}

/// What is known of one daemon. There is a token of it.
#[derive(Debug, Default)]
struct Hosted {
    tokens: BTreeMap<Resident, Token>,
    joined: BTreeSet<Resident>,
    route: Route,
    /// Since when calls are not answered.
    silent_since: Option<Instant>,
}

/// The tokens of one life of an agent: one, or for a moment two, when it is told again.
#[derive(Debug)]
struct Token {
    number: u64,
    tellings: BTreeSet<u64>,
}

/// Whether a daemon can be reached.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Route {
    /// Nothing is known.
    #[default]
    Unknown,
    /// It is being probed.
    Probed,
    /// It answered, and answered again after an agent of it had left.
    Known,
}

/// What a daemon says of whom it hosts.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Hosts<'h> {
    /// Nothing.
    Unsaid,
    /// Those of whom there was a token when it was called.
    AsKnown,
    /// These.
    Named(&'h [(AgentId, Incarnation)]),
}

/// What follows from a token that has come or gone.
#[derive(Debug, Default, PartialEq, Eq)]
pub(crate) struct Follows {
    pub(crate) passed_on: Vec<Presence>,
    /// Its daemon is to be probed.
    pub(crate) probe: bool,
}

// === impl Roster ===

impl Roster {
    pub(crate) fn new(own: DaemonId, lease: Duration) -> Roster {
        Roster { own, lease, tokens: 0, daemons: BTreeMap::new() }
    }

    /// How many tokens have come. To be asked for when a call goes out.
    pub(crate) fn mark(&self) -> u64 {
        self.tokens
    }

    /// A token has come.
    pub(crate) fn put(&mut self, resident: Resident, telling: u64) -> Follows {
        self.tokens += 1;
        let is_own = resident.daemon == self.own;
        let hosted = self.daemons.entry(resident.daemon.clone()).or_default();
        let number = self.tokens;
        let token = hosted.tokens.entry(resident.clone());
        let token = token.or_insert_with(|| Token { number, tellings: BTreeSet::new() });
        token.tellings.insert(telling);
        if is_own || hosted.route == Route::Known {
            return Follows { passed_on: hosted.join(resident), probe: false };
        }
        let probe = hosted.route == Route::Unknown;
        hosted.route = Route::Probed;
        Follows { passed_on: Vec::new(), probe }
    }

    /// A token has gone. Whether its daemon went with it is not known; it is probed at once, so that
    /// who comes next need not wait for that.
    pub(crate) fn delete(&mut self, resident: &Resident, telling: u64) -> Follows {
        let Some(hosted) = self.daemons.get_mut(&resident.daemon) else {
            return Follows::default();
        };
        let Some(token) = hosted.tokens.get_mut(resident) else { return Follows::default() };
        token.tellings.remove(&telling);
        if !token.tellings.is_empty() {
            return Follows::default();
        }
        hosted.tokens.remove(resident);
        let passed_on = hosted.leave(resident);
        let probe = hosted.route == Route::Known && resident.daemon != self.own;
        if hosted.tokens.is_empty() {
            self.daemons.remove(&resident.daemon);
            return Follows { passed_on, probe: false };
        }
        if probe {
            hosted.route = Route::Probed;
        }
        Follows { passed_on, probe }
    }

    /// Whether a daemon is still to be probed.
    pub(crate) fn awaits(&self, daemon: &DaemonId) -> bool {
        self.daemons.get(daemon).is_some_and(|hosted| hosted.route == Route::Probed)
    }

    /// Of whom there are tokens, by daemon; of all, or of one.
    pub(crate) fn known(
        &self,
        one: Option<&DaemonId>,
    ) -> impl Iterator<Item = (DaemonId, Vec<(AgentId, Incarnation)>)> {
        let is_meant = move |daemon: &DaemonId| one.is_none_or(|one| one == daemon);
        self.daemons.iter().filter(move |(daemon, _)| is_meant(daemon)).map(|(daemon, hosted)| {
            let residents = hosted.tokens.keys();
            let lives = residents.map(|resident| (resident.agent.clone(), resident.incarnation));
            (daemon.clone(), lives.collect())
        })
    }

    /// A daemon has answered a call that went out at `mark`, and said whom it hosts.
    pub(crate) fn answered(
        &mut self,
        daemon: &DaemonId,
        hosts: Hosts<'_>,
        mark: u64,
    ) -> Vec<Presence> {
        let is_own = *daemon == self.own;
        let Some(hosted) = self.daemons.get_mut(daemon).filter(|_| !is_own) else {
            return Vec::new();
        };
        hosted.route = Route::Known;
        hosted.silent_since = None;
        let named: BTreeSet<_> = match hosts {
            Hosts::Named(hosts) => hosts.iter().map(|(agent, life)| (agent, *life)).collect(),
            Hosts::AsKnown | Hosts::Unsaid => BTreeSet::new(),
        };
        let is_hosted = |resident: &Resident, token: &Token| match hosts {
            Hosts::Named(_) => named.contains(&(&resident.agent, resident.incarnation)),
            Hosts::AsKnown => token.number <= mark,
            Hosts::Unsaid => true,
        };
        let (mut here, mut ghosts) = (Vec::new(), Vec::new());
        for (resident, token) in &hosted.tokens {
            if is_hosted(resident, token) {
                here.push(resident.clone());
            } else if token.number <= mark {
                ghosts.push(resident.clone());
            }
        }
        let left: Vec<_> = ghosts.iter().flat_map(|resident| hosted.leave(resident)).collect();
        let joined = here.into_iter().flat_map(|resident| hosted.join(resident));
        left.into_iter().chain(joined).collect()
    }

    /// A probe was given up: the calls go on.
    pub(crate) fn unreached(&mut self, daemon: &DaemonId) {
        if let Some(hosted) = self.daemons.get_mut(daemon).filter(|it| it.route == Route::Probed) {
            hosted.route = Route::Unknown;
        }
    }

    /// A call to all that went out at `mark` has ended, and these have answered. Who has not
    /// answered for a lease has left.
    pub(crate) fn called(
        &mut self,
        answered: &BTreeSet<DaemonId>,
        mark: u64,
        now: Instant,
    ) -> Vec<Presence> {
        let mut left = Vec::new();
        for (daemon, hosted) in &mut self.daemons {
            let is_new = hosted.tokens.values().all(|token| token.number > mark);
            if *daemon == self.own || is_new || answered.contains(daemon) {
                continue;
            }
            let since = *hosted.silent_since.get_or_insert(now);
            if now.duration_since(since) >= self.lease && !hosted.joined.is_empty() {
                tracing::warn!(%daemon, "its tokens are here and it does not answer: it is gone");
                hosted.route = Route::Unknown;
                left.extend(std::mem::take(&mut hosted.joined).into_iter().map(Presence::Left));
            }
        }
        left
    }

    /// Who has a token here and did not answer the last call.
    pub(crate) fn silent(&self) -> BTreeSet<DaemonId> {
        let silent = self.daemons.iter().filter(|(_, hosted)| hosted.silent_since.is_some());
        silent.map(|(daemon, _)| daemon.clone()).collect()
    }
}

// === impl Hosted ===

impl Hosted {
    /// Of two lives of one agent here, the older is what is left of its death.
    fn join(&mut self, resident: Resident) -> Vec<Presence> {
        // Lives of one agent stand side by side, the newest last.
        let after = self.joined.range(&resident..).find(|other| **other != resident);
        let is_overtaken = after.is_some_and(|other| other.agent == resident.agent);
        if is_overtaken || !self.joined.insert(resident.clone()) {
            return Vec::new();
        }
        vec![Presence::Joined(resident)]
    }

    fn leave(&mut self, resident: &Resident) -> Vec<Presence> {
        let left = self.joined.take(resident).map(Presence::Left);
        left.into_iter().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LEASE: Duration = Duration::from_secs(4);

    fn roster() -> Roster {
        Roster::new(daemon("own"), LEASE)
    }

    fn daemon(name: &str) -> DaemonId {
        DaemonId::new(name).expect("a name")
    }

    fn resident(agent: &str, at: &str, life: u64) -> Resident {
        let agent = AgentId::new(agent).expect("a name");
        Resident { agent, daemon: daemon(at), incarnation: Incarnation(life) }
    }

    fn hosts(residents: &[Resident]) -> Vec<(AgentId, Incarnation)> {
        residents.iter().map(|each| (each.agent.clone(), each.incarnation)).collect()
    }

    #[test]
    fn nobody_joins_before_its_daemon_has_answered() {
        let (mut roster, robot) = (roster(), resident("robot", "pi", 1));
        assert_eq!(roster.put(robot.clone(), 0), Follows { passed_on: vec![], probe: true });
        let second = resident("sensor", "pi", 1);
        assert_eq!(roster.put(second.clone(), 0), Follows::default(), "one probe is enough");
        let joined = roster.answered(&daemon("pi"), Hosts::Unsaid, roster.mark());
        assert_eq!(joined, [robot.clone(), second].map(Presence::Joined));
        let third = resident("late", "pi", 1);
        assert_eq!(roster.put(third.clone(), 0).passed_on, [Presence::Joined(third)]);
        let Follows { passed_on, probe } = roster.delete(&robot, 0);
        assert_eq!(passed_on, [Presence::Left(robot.clone())]);
        assert!(
            probe && roster.awaits(&daemon("pi")),
            "whether its daemon went along is not known"
        );
        assert_eq!(roster.put(robot.clone(), 0), Follows::default(), "one probe is enough");
        let joined = roster.answered(&daemon("pi"), Hosts::AsKnown, roster.mark());
        assert_eq!(joined, [Presence::Joined(robot)]);
        assert!(!roster.awaits(&daemon("pi")));
    }

    #[test]
    fn who_is_told_again_does_not_blink() {
        let (mut roster, robot) = (roster(), resident("robot", "own", 1));
        assert_eq!(roster.put(robot.clone(), 0).passed_on, [Presence::Joined(robot.clone())]);
        assert_eq!(roster.put(robot.clone(), 1).passed_on, []);
        assert_eq!(roster.delete(&robot, 0).passed_on, []);
        assert_eq!(roster.delete(&robot, 1).passed_on, [Presence::Left(robot)]);
    }

    #[test]
    fn whom_its_daemon_does_not_host_is_gone() {
        let (mut roster, old, new) =
            (roster(), resident("robot", "pi", 1), resident("robot", "pi", 2));
        roster.put(old.clone(), 0);
        roster.answered(&daemon("pi"), Hosts::Unsaid, roster.mark());
        let mark = roster.mark();
        let came = roster.put(new.clone(), 0).passed_on;
        assert_eq!(came, [Presence::Joined(new.clone())]);
        let mine = hosts(std::slice::from_ref(&new));
        assert_eq!(
            roster.answered(&daemon("pi"), Hosts::Named(&mine), mark),
            [Presence::Left(old)]
        );
        assert_eq!(
            roster.answered(&daemon("pi"), Hosts::Named(&[]), mark),
            [],
            "it came after the call"
        );
        assert_eq!(
            roster.answered(&daemon("pi"), Hosts::Named(&[]), mark + 1),
            [Presence::Left(new)]
        );
    }

    #[test]
    fn who_is_as_known_is_here_and_nobody_else() {
        let (mut roster, robot) = (roster(), resident("robot", "pi", 1));
        roster.put(robot.clone(), 0);
        let mark = roster.mark();
        roster.put(resident("ghost", "pi", 1), 0);
        let joined = roster.answered(&daemon("pi"), Hosts::AsKnown, mark);
        assert_eq!(joined, [Presence::Joined(robot)], "the other came after the call");
    }

    #[test]
    fn the_dead_do_not_take_the_place_of_the_living() {
        let (mut roster, old, new) =
            (roster(), resident("robot", "pi", 1), resident("robot", "pi", 2));
        roster.put(new.clone(), 0);
        roster.answered(&daemon("pi"), Hosts::Unsaid, roster.mark());
        assert_eq!(roster.put(old.clone(), 0).passed_on, []);
        assert_eq!(roster.delete(&old, 0).passed_on, []);
        assert_eq!(roster.delete(&new, 0).passed_on, [Presence::Left(new)]);
    }

    #[test]
    fn who_does_not_answer_for_a_lease_is_gone_until_it_does() {
        let (mut roster, robot, start) = (roster(), resident("robot", "pi", 1), Instant::now());
        roster.put(robot.clone(), 0);
        roster.answered(&daemon("pi"), Hosts::Unsaid, roster.mark());
        let (nobody, mark) = (BTreeSet::new(), roster.mark());
        assert_eq!(roster.called(&nobody, mark - 1, start), [], "it came after the call");
        assert!(roster.silent().is_empty());
        assert_eq!(roster.called(&nobody, mark, start), []);
        assert_eq!(roster.silent().first(), Some(&daemon("pi")));
        let later = start + LEASE;
        assert_eq!(roster.called(&nobody, mark, later), [Presence::Left(robot.clone())]);
        assert_eq!(roster.called(&nobody, mark, later), [], "once is enough");
        let back = roster.answered(&daemon("pi"), Hosts::Unsaid, mark);
        assert_eq!(back, [Presence::Joined(robot)]);
        assert!(roster.silent().is_empty());
    }
}
