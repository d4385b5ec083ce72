//! Membership as this daemon sees it: which agents are present. It is computed from liveliness
//! tokens, and from the answers of daemons to *roll calls*, the periodic queries to all daemons.
//!
//! A token alone does not prove presence. It may arrive before the route to its daemon exists. A
//! router that has not yet detected a failure can advertise the token of a dead agent again, to
//! daemons that had already seen it removed; these daemons then never receive its removal. So three
//! rules hold: no agent joins before its daemon has answered; an agent that its daemon does not
//! host has left; and all agents of a daemon have left if the daemon does not answer for a lease.

use std::collections::{BTreeMap, BTreeSet};
use std::time::{Duration, Instant};

use acl::{AgentId, DaemonId, Incarnation};
use substrate::{Presence, Resident};

/// Maximum number of joined agents: four times as many as a Domain Maintainer accepts. Tokens
/// beyond this number have no effect, and agents that have joined stay.
const AGENTS_MAX: usize = 4_096;

/// Maximum number of joined agents per name in a certificate, which covers a daemon and its guests.
/// Further agents do not join. Ten daemons usually share about a thousand agents. At least four
/// daemons at this limit are needed to exclude all others.
const AGENTS_PER_HOST_MAX: usize = 1_024;

/// Maximum number of tokens that their daemons have not confirmed. Tokens are not signed, so any
/// client can invent them; beyond the limit the oldest unconfirmed tokens are dropped.
const UNCONFIRMED_MAX: usize = 2 * AGENTS_MAX;

/// Maximum number of declarations of one token that are recorded; of more, the oldest is dropped.
/// Normally there is one, or two for a moment when the token is declared again.
const TELLINGS_MAX: usize = 8;

/// The tokens and answers of all daemons, and the presence of agents that follows from them.
///
/// The methods return changes of presence, which have to be passed on in the order of the calls of
/// the methods.
#[derive(Debug)]
pub(crate) struct Membership {
    own: DaemonId,
    /// Longest time that a daemon may be silent before its agents count as having left.
    lease: Duration,
    /// Number of tokens that have arrived so far. Tokens with a number beyond that of a roll call
    /// arrived after the roll call was sent, so its answers do not cover them.
    tokens: u64,
    daemons: BTreeMap<DaemonId, DaemonMembers>,
    /// Numbers of tokens and of joined agents, which are compared with the limits on them.
    counts: MemberCounts,
    /// Tokens that were rejected because there is no room, and have not been reported yet.
    rejected: Vec<Resident>,
}

/// Numbers of tokens and of joined agents, which are compared with the limits on them.
#[derive(Debug)]
struct MemberCounts {
    own: DaemonId,
    tokens: usize,
    /// Numbers of joined agents, by the name in the certificate of their daemon.
    joined: BTreeMap<String, usize>,
}

/// State of one daemon that has at least one token.
#[derive(Debug, Default)]
struct DaemonMembers {
    tokens: BTreeMap<Resident, TokenDeclarations>,
    joined: BTreeSet<Resident>,
    route_state: RouteState,
    /// Time of the first roll call that the daemon did not answer; `None` if it answered the last
    /// one.
    silent_since: Option<Instant>,
}

/// The declarations of the token of one incarnation of an agent: one, or two for a moment when it
/// is declared again.
#[derive(Debug)]
struct TokenDeclarations {
    number: u64,
    rounds: BTreeSet<u64>,
    /// Whether it was reported that there is no room for the token.
    is_surplus: bool,
}

/// Whether the route to a daemon is known to work.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum RouteState {
    /// The route is not known to work: the daemon was not probed yet, or the probe ended without an
    /// answer.
    #[default]
    Unknown,
    /// A probe of the daemon is under way.
    Probed,
    /// The daemon has answered the latest probe. The removal of a token starts another probe.
    Known,
}

/// Agents that a daemon hosts, according to its answer to a roll call or a probe.
#[derive(Clone, Copy, Debug)]
pub(crate) enum HostedAgents<'h> {
    /// The answer does not list the agents; all agents with a token are taken as hosted.
    Unstated,
    /// The daemon hosts exactly the agents that had a token when the query was sent: the digest in
    /// the query was right.
    AsKnown,
    /// The daemon hosts exactly these agents.
    Listed(&'h [(AgentId, Incarnation)]),
}

/// Effects of the arrival or removal of a token.
#[derive(Debug, Default, PartialEq, Eq)]
pub(crate) struct TokenEffects {
    pub(crate) passed_on: Vec<Presence>,
    /// Whether the daemon that the token belongs to has to be probed.
    pub(crate) probe: bool,
}

// === impl Membership ===

impl Membership {
    pub(crate) fn new(own: DaemonId, lease: Duration) -> Membership {
        let (daemons, surplus) = (BTreeMap::new(), Vec::new());
        let crowd = MemberCounts { own: own.clone(), tokens: 0, joined: BTreeMap::new() };
        Membership { own, lease, tokens: 0, daemons, counts: crowd, rejected: surplus }
    }

    /// Returns the number of tokens received so far. It must be stored when a roll call or a probe
    /// is sent, as the `mark` of that query.
    pub(crate) fn watermark(&self) -> u64 {
        self.tokens
    }

    /// Handles a token that has arrived; `telling` is the number of times that the declaration of
    /// the token was repeated. The agent joins at once if its daemon is this one or is known to be
    /// reachable.
    pub(crate) fn add_token(&mut self, resident: Resident, telling: u64) -> TokenEffects {
        self.tokens += 1;
        let is_own = resident.daemon == self.own;
        if self.counts.has_unconfirmed(UNCONFIRMED_MAX) {
            self.forget_unconfirmed();
        }
        let hosted = self.daemons.entry(resident.daemon.clone()).or_default();
        let number = self.tokens;
        let crowd = &mut self.counts;
        let token = hosted.tokens.entry(resident.clone()).or_insert_with(|| {
            crowd.tokens += 1;
            TokenDeclarations { number, rounds: BTreeSet::new(), is_surplus: false }
        });
        token.rounds.insert(telling);
        if token.rounds.len() > TELLINGS_MAX {
            token.rounds.pop_first();
        }
        if is_own || hosted.route_state == RouteState::Known {
            let passed_on = hosted.join(resident, crowd, &mut self.rejected);
            return TokenEffects { passed_on, probe: false };
        }
        let probe = hosted.route_state == RouteState::Unknown;
        hosted.route_state = RouteState::Probed;
        TokenEffects { passed_on: Vec::new(), probe }
    }

    /// Returns the tokens that were rejected for lack of room since the last call of this method,
    /// each once.
    pub(crate) fn take_rejected(&mut self) -> Vec<Resident> {
        std::mem::take(&mut self.rejected)
    }

    /// Drops the older half of the tokens that their daemons have not confirmed. If a valid token
    /// is among them, its agent joins when the daemon declares the token again.
    fn forget_unconfirmed(&mut self) {
        let unconfirmed = self.daemons.values().flat_map(|hosted| {
            let waiting = hosted.tokens.iter().filter(|(each, _)| !hosted.joined.contains(*each));
            waiting.map(|(_, token)| token.number)
        });
        let mut numbers: Vec<_> = unconfirmed.collect();
        let middle = numbers.len() / 2;
        let (_, youngest, _) = numbers.select_nth_unstable(middle);
        let youngest = *youngest;
        for hosted in self.daemons.values_mut() {
            let DaemonMembers { tokens, joined, .. } = hosted;
            let forgotten =
                tokens.extract_if(.., |each, it| it.number <= youngest && !joined.contains(each));
            for (resident, _) in forgotten {
                self.counts.tokens -= 1;
                self.rejected.push(resident);
            }
        }
        self.daemons.retain(|_, hosted| !hosted.tokens.is_empty());
    }

    /// Handles the withdrawal of an agent by this daemon: all its tokens are removed.
    pub(crate) fn withdraw_own(&mut self, resident: &Resident) -> Vec<Presence> {
        let Some(hosted) = self.daemons.get_mut(&resident.daemon) else { return Vec::new() };
        if hosted.tokens.remove(resident).is_some() {
            self.counts.tokens -= 1;
        }
        let left = hosted.leave(resident, &mut self.counts);
        if hosted.tokens.is_empty() {
            self.daemons.remove(&resident.daemon);
        }
        left
    }

    /// Handles the removal of a token. The daemon of the token may have gone too, so the daemon is
    /// probed at once: agents of the daemon that join next then need not wait for the result.
    pub(crate) fn remove_token(&mut self, resident: &Resident, telling: u64) -> TokenEffects {
        let Some(hosted) = self.daemons.get_mut(&resident.daemon) else {
            return TokenEffects::default();
        };
        let Some(token) = hosted.tokens.get_mut(resident) else { return TokenEffects::default() };
        token.rounds.remove(&telling);
        if !token.rounds.is_empty() {
            return TokenEffects::default();
        }
        hosted.tokens.remove(resident);
        self.counts.tokens -= 1;
        let passed_on = hosted.leave(resident, &mut self.counts);
        let probe = hosted.route_state == RouteState::Known && resident.daemon != self.own;
        if hosted.tokens.is_empty() {
            self.daemons.remove(&resident.daemon);
            return TokenEffects { passed_on, probe: false };
        }
        if probe {
            hosted.route_state = RouteState::Probed;
        }
        TokenEffects { passed_on, probe }
    }

    /// Whether a probe of `daemon` is still under way.
    pub(crate) fn awaits(&self, daemon: &DaemonId) -> bool {
        self.daemons.get(daemon).is_some_and(|hosted| hosted.route_state == RouteState::Probed)
    }

    /// Returns the agents that have a token, per daemon; if `one` is given, of that daemon only.
    pub(crate) fn known_agents(
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

    /// Handles the answer of `daemon` to the query that was sent when the number of tokens was
    /// `mark`. Agents that the answer confirms join. Agents that had a token at that time and are
    /// not hosted leave.
    pub(crate) fn receive_reply(
        &mut self,
        daemon: &DaemonId,
        hosts: HostedAgents<'_>,
        mark: u64,
    ) -> Vec<Presence> {
        let Membership { own, daemons, counts: crowd, rejected: surplus, .. } = self;
        let Some(hosted) = daemons.get_mut(daemon).filter(|_| daemon != own) else {
            return Vec::new();
        };
        hosted.route_state = RouteState::Known;
        hosted.silent_since = None;
        let named: BTreeSet<_> = match hosts {
            HostedAgents::Listed(hosts) => {
                hosts.iter().map(|(agent, incarnation)| (agent, *incarnation)).collect()
            }
            HostedAgents::AsKnown | HostedAgents::Unstated => BTreeSet::new(),
        };
        let is_hosted = |resident: &Resident, token: &TokenDeclarations| match hosts {
            HostedAgents::Listed(_) => named.contains(&(&resident.agent, resident.incarnation)),
            HostedAgents::AsKnown => token.number <= mark,
            HostedAgents::Unstated => true,
        };
        let (mut here, mut ghosts) = (Vec::new(), Vec::new());
        for (resident, token) in &hosted.tokens {
            if is_hosted(resident, token) {
                here.push(resident.clone());
            } else if token.number <= mark {
                ghosts.push(resident.clone());
            }
        }
        let left = ghosts.iter().flat_map(|resident| hosted.leave(resident, crowd));
        let mut follows: Vec<_> = left.collect();
        for resident in here {
            follows.extend(hosted.join(resident, crowd, surplus));
        }
        follows
    }

    /// Ends a probe of `daemon` that was given up. The daemon still receives the roll calls.
    pub(crate) fn unreached(&mut self, daemon: &DaemonId) {
        if let Some(hosted) =
            self.daemons.get_mut(daemon).filter(|it| it.route_state == RouteState::Probed)
        {
            hosted.route_state = RouteState::Unknown;
        }
    }

    /// Handles the end of a roll call that was sent when the number of tokens was `mark`;
    /// `answered` contains the daemons that have answered. If a daemon has not answered for the
    /// time `lease`, its agents leave.
    pub(crate) fn finish_round(
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
                hosted.route_state = RouteState::Unknown;
                self.counts.leave(daemon, hosted.joined.len());
                left.extend(std::mem::take(&mut hosted.joined).into_iter().map(Presence::Left));
            }
        }
        left
    }

    /// Returns the daemons that have a token and did not answer the last roll call.
    pub(crate) fn silent(&self) -> BTreeSet<DaemonId> {
        let silent = self.daemons.iter().filter(|(_, hosted)| hosted.silent_since.is_some());
        silent.map(|(daemon, _)| daemon.clone()).collect()
    }
}

// === impl DaemonMembers ===

impl DaemonMembers {
    /// Lets an agent join if there is room. If two incarnations of the agent have tokens, the older
    /// one is a remnant, and the newer one takes its place. If the newer token was invented, the
    /// older incarnation joins again with the next answer of its daemon.
    fn join(
        &mut self,
        resident: Resident,
        crowd: &mut MemberCounts,
        surplus: &mut Vec<Resident>,
    ) -> Vec<Presence> {
        // The set is sorted by agent, so incarnations of one agent are adjacent, the newest last.
        let after = self.joined.range(&resident..).next();
        if after.is_some_and(|other| other.agent == resident.agent) {
            return Vec::new();
        }
        let before = self.joined.range(..&resident).next_back().cloned();
        match before.filter(|other| other.agent == resident.agent) {
            Some(older) => drop(self.joined.remove(&older)),
            None if crowd.has_room(&resident.daemon) => crowd.join(&resident.daemon),
            None => {
                let token = self.tokens.get_mut(&resident);
                if token.is_some_and(|token| !std::mem::replace(&mut token.is_surplus, true)) {
                    surplus.push(resident);
                }
                return Vec::new();
            }
        }
        self.joined.insert(resident.clone());
        vec![Presence::Joined(resident)]
    }

    fn leave(&mut self, resident: &Resident, crowd: &mut MemberCounts) -> Vec<Presence> {
        let left = self.joined.take(resident);
        if left.is_some() {
            crowd.leave(&resident.daemon, 1);
        }
        left.map(Presence::Left).into_iter().collect()
    }
}

// === impl MemberCounts ===

impl MemberCounts {
    /// Whether one more agent of `daemon` may join; always `true` for this daemon itself.
    fn has_room(&self, daemon: &DaemonId) -> bool {
        if *daemon == self.own {
            return true;
        }
        let of_host = self.joined.get(daemon.host()).copied().unwrap_or_default();
        of_host < AGENTS_PER_HOST_MAX && self.all() < AGENTS_MAX
    }

    fn has_unconfirmed(&self, count: usize) -> bool {
        self.tokens.saturating_sub(self.all()) >= count
    }

    fn all(&self) -> usize {
        self.joined.values().sum()
    }

    fn join(&mut self, daemon: &DaemonId) {
        *self.joined.entry(daemon.host().to_owned()).or_default() += 1;
    }

    fn leave(&mut self, daemon: &DaemonId, count: usize) {
        let host = daemon.host();
        if let Some(here) = self.joined.get_mut(host) {
            *here = here.saturating_sub(count);
            if *here == 0 {
                self.joined.remove(host);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LEASE: Duration = Duration::from_secs(4);

    fn roster() -> Membership {
        Membership::new(daemon("own"), LEASE)
    }

    fn daemon(name: &str) -> DaemonId {
        DaemonId::new(name).expect("a name")
    }

    fn resident(agent: &str, at: &str, incarnation: u64) -> Resident {
        let agent = AgentId::new(agent).expect("a name");
        Resident { agent, daemon: daemon(at), incarnation: Incarnation(incarnation) }
    }

    fn hosts(residents: &[Resident]) -> Vec<(AgentId, Incarnation)> {
        residents.iter().map(|each| (each.agent.clone(), each.incarnation)).collect()
    }

    #[test]
    fn no_agent_joins_before_its_daemon_has_answered() {
        let (mut roster, robot) = (roster(), resident("robot", "pi", 1));
        assert_eq!(
            roster.add_token(robot.clone(), 0),
            TokenEffects { passed_on: vec![], probe: true }
        );
        let second = resident("sensor", "pi", 1);
        assert_eq!(
            roster.add_token(second.clone(), 0),
            TokenEffects::default(),
            "one probe is enough"
        );
        let joined =
            roster.receive_reply(&daemon("pi"), HostedAgents::Unstated, roster.watermark());
        assert_eq!(joined, [robot.clone(), second].map(Presence::Joined));
        let third = resident("late", "pi", 1);
        assert_eq!(roster.add_token(third.clone(), 0).passed_on, [Presence::Joined(third)]);
        let TokenEffects { passed_on, probe } = roster.remove_token(&robot, 0);
        assert_eq!(passed_on, [Presence::Left(robot.clone())]);
        assert!(probe && roster.awaits(&daemon("pi")), "its daemon may have left as well");
        assert_eq!(
            roster.add_token(robot.clone(), 0),
            TokenEffects::default(),
            "one probe is enough"
        );
        let joined = roster.receive_reply(&daemon("pi"), HostedAgents::AsKnown, roster.watermark());
        assert_eq!(joined, [Presence::Joined(robot)]);
        assert!(!roster.awaits(&daemon("pi")));
    }

    #[test]
    fn an_agent_that_is_declared_again_stays_present() {
        let (mut roster, robot) = (roster(), resident("robot", "own", 1));
        assert_eq!(roster.add_token(robot.clone(), 0).passed_on, [Presence::Joined(robot.clone())]);
        assert_eq!(roster.add_token(robot.clone(), 1).passed_on, []);
        assert_eq!(roster.remove_token(&robot, 0).passed_on, []);
        assert_eq!(roster.remove_token(&robot, 1).passed_on, [Presence::Left(robot)]);
    }

    #[test]
    fn an_agent_that_its_daemon_does_not_host_leaves() {
        let (mut roster, old, new) =
            (roster(), resident("robot", "pi", 1), resident("robot", "pi", 2));
        roster.add_token(old.clone(), 0);
        roster.receive_reply(&daemon("pi"), HostedAgents::Unstated, roster.watermark());
        let mark = roster.watermark();
        let came = roster.add_token(new.clone(), 0).passed_on;
        assert_eq!(came, [Presence::Joined(new.clone())]);
        let mine = hosts(std::slice::from_ref(&new));
        // The newer incarnation has replaced the older one.
        assert_eq!(roster.receive_reply(&daemon("pi"), HostedAgents::Listed(&mine), mark), []);
        assert_eq!(roster.remove_token(&old, 0).passed_on, []);
        assert_eq!(
            roster.receive_reply(&daemon("pi"), HostedAgents::Listed(&[]), mark),
            [],
            "it came after the call"
        );
        assert_eq!(
            roster.receive_reply(&daemon("pi"), HostedAgents::Listed(&[]), mark + 1),
            [Presence::Left(new)]
        );
    }

    #[test]
    fn a_right_digest_confirms_earlier_tokens_only() {
        let (mut roster, robot) = (roster(), resident("robot", "pi", 1));
        roster.add_token(robot.clone(), 0);
        let mark = roster.watermark();
        roster.add_token(resident("ghost", "pi", 1), 0);
        let joined = roster.receive_reply(&daemon("pi"), HostedAgents::AsKnown, mark);
        assert_eq!(joined, [Presence::Joined(robot)], "the other came after the call");
    }

    #[test]
    fn an_older_incarnation_does_not_displace_a_newer_one() {
        let (mut roster, old, new) =
            (roster(), resident("robot", "pi", 1), resident("robot", "pi", 2));
        roster.add_token(new.clone(), 0);
        roster.receive_reply(&daemon("pi"), HostedAgents::Unstated, roster.watermark());
        assert_eq!(roster.add_token(old.clone(), 0).passed_on, []);
        assert_eq!(roster.remove_token(&old, 0).passed_on, []);
        assert_eq!(roster.remove_token(&new, 0).passed_on, [Presence::Left(new)]);
    }

    #[test]
    fn a_daemon_that_is_silent_for_a_lease_is_gone_until_it_answers() {
        let (mut roster, robot, start) = (roster(), resident("robot", "pi", 1), Instant::now());
        roster.add_token(robot.clone(), 0);
        roster.receive_reply(&daemon("pi"), HostedAgents::Unstated, roster.watermark());
        let (nobody, mark) = (BTreeSet::new(), roster.watermark());
        assert_eq!(roster.finish_round(&nobody, mark - 1, start), [], "it came after the call");
        assert!(roster.silent().is_empty());
        assert_eq!(roster.finish_round(&nobody, mark, start), []);
        assert_eq!(roster.silent().first(), Some(&daemon("pi")));
        let later = start + LEASE;
        assert_eq!(roster.finish_round(&nobody, mark, later), [Presence::Left(robot.clone())]);
        assert_eq!(roster.finish_round(&nobody, mark, later), [], "once is enough");
        let back = roster.receive_reply(&daemon("pi"), HostedAgents::Unstated, mark);
        assert_eq!(back, [Presence::Joined(robot)]);
        assert!(roster.silent().is_empty());
    }

    /// A token is not signed: any client can declare one for an agent of another daemon.
    #[test]
    fn an_invented_incarnation_displaces_no_agent_for_good() {
        let (mut roster, robot) = (roster(), resident("robot", "pi", 1));
        roster.add_token(robot.clone(), 0);
        roster.receive_reply(&daemon("pi"), HostedAgents::Unstated, roster.watermark());
        let invented = resident("robot", "pi", 1 << 53);
        assert_eq!(
            roster.add_token(invented.clone(), 0).passed_on,
            [Presence::Joined(invented.clone())]
        );
        let mine = hosts(std::slice::from_ref(&robot));
        let follows =
            roster.receive_reply(&daemon("pi"), HostedAgents::Listed(&mine), roster.watermark());
        assert_eq!(follows, [Presence::Left(invented), Presence::Joined(robot)]);
    }

    #[test]
    fn an_agent_beyond_the_limit_joins_once_there_is_room() {
        let mut roster = roster();
        let swarm = |host: &str, count: usize| -> Vec<Resident> {
            let at = format!("{host}--cli-1");
            (0..count).map(|number| resident(&format!("a-{number}"), &at, 1)).collect()
        };
        let come = |roster: &mut Membership, residents: &[Resident]| {
            for one in residents {
                roster.add_token(one.clone(), 0);
            }
            roster
                .receive_reply(&residents[0].daemon, HostedAgents::Unstated, roster.watermark())
                .len()
        };
        let many = swarm("p1", AGENTS_PER_HOST_MAX + 2);
        assert_eq!(come(&mut roster, &many), AGENTS_PER_HOST_MAX);
        let surplus = roster.take_rejected();
        assert_eq!(surplus.len(), 2, "they are reported");
        assert_eq!(come(&mut roster, &[resident("own", "p1", 1)]), 0, "its host's are counted");
        assert_eq!(roster.take_rejected().len(), 1);
        for host in ["p2", "p3", "p4"] {
            assert_eq!(come(&mut roster, &swarm(host, AGENTS_PER_HOST_MAX)), AGENTS_PER_HOST_MAX);
        }
        let late = resident("robot", "pi", 1);
        assert_eq!(come(&mut roster, std::slice::from_ref(&late)), 0, "there is no room");
        let next = resident("a-7", "p1--cli-1", 2);
        assert_eq!(roster.add_token(next.clone(), 0).passed_on, [Presence::Joined(next.clone())]);
        assert_eq!(roster.remove_token(&next, 0).passed_on, [Presence::Left(next)]);
        let joined =
            roster.receive_reply(&daemon("pi"), HostedAgents::Unstated, roster.watermark());
        assert_eq!(joined, [Presence::Joined(late)]);
    }

    #[test]
    fn invented_tokens_displace_no_agent() {
        let (mut roster, robot) = (roster(), resident("robot", "pi", 1));
        roster.add_token(robot.clone(), 0);
        roster.receive_reply(&daemon("pi"), HostedAgents::Unstated, roster.watermark());
        for number in 0..3 * UNCONFIRMED_MAX as u64 {
            roster.add_token(resident("ghost", &format!("g-{}", number % 100), number), 0);
            roster.add_token(resident("ghost", "pi", number), number);
            roster.add_token(resident("ghost", "pi", 1), number);
        }
        assert!(roster.counts.tokens <= UNCONFIRMED_MAX + AGENTS_MAX);
        let tokens = roster.daemons.values().map(|hosted| hosted.tokens.len());
        assert_eq!(tokens.sum::<usize>(), roster.counts.tokens);
        let tellings = roster.daemons.values().flat_map(|hosted| hosted.tokens.values());
        assert!(tellings.map(|token| token.rounds.len()).all(|count| count <= TELLINGS_MAX));
        assert!(!roster.take_rejected().is_empty());
        assert_eq!(roster.remove_token(&robot, 0).passed_on, [Presence::Left(robot)]);
    }
}
