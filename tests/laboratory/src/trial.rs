//! Plays a seed and returns the result.

use std::hash::{DefaultHasher, Hash, Hasher};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use acl::content::Outcome;
use tokio::time::{Instant, sleep_until};

use crate::chains::{self, ChainCounts};
use crate::checks;
use crate::cluster::Cluster;
use crate::fault_effects::FaultEffects;
use crate::script::{FAULTS_UNTIL, Safeguard, TrialScript};
use crate::stops::StopTrial;
use crate::trial_error::TrialError;

/// Time limit for everything to end after the last fault.
const SETTLES_WITHIN: Duration = Duration::from_secs(400);

/// Interval at which people read their terminals.
const LOOKS_EVERY: Duration = Duration::from_millis(50);

/// Time at the end of a trial in which nothing may happen.
const QUIET: Duration = Duration::from_secs(3);

/// Result of a trial.
#[derive(Debug)]
pub struct TrialResult {
    /// The seed.
    pub seed: u64,
    /// The promises that were broken; empty if all is well.
    pub broken: Vec<String>,
    /// Counters of the faults that took effect.
    pub effects: FaultEffects,
    /// Counts of the goals and their outcomes.
    pub goals: GoalCounts,
    /// Hash of all messages ever sent, with their times.
    pub digest: u64,
    /// Numbers of daemons, of agents with different names, of goals and of faults.
    pub size: [usize; 4],
    /// Duration in simulated time.
    pub lasted: Duration,
    /// All reports that people received, for diagnosis.
    pub transcript: Vec<String>,
    /// Counts of the chains of causes; `None` if the trial has no history agent.
    pub chains: Option<ChainCounts>,
}

/// Counts of the goals with a terminal that ran to the end.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct GoalCounts {
    /// Goals requested.
    pub asked: usize,
    /// Goals that Journals kept, according to the reports.
    pub accepted: usize,
    /// Goals that were reached, or are kept and hold.
    pub achieved: usize,
}

/// Plays a seed. If `without` names a guard, the trial runs without it.
///
/// # Errors
///
/// Returns an error if the trial cannot be set up: its files cannot be created, or the drawn plan
/// is no valid building.
pub fn play(seed: u64, without: Option<Safeguard>) -> Result<TrialResult, TrialError> {
    play_trial(seed, without, Extra::None)
}

/// Plays a seed in which a person stops everything in the midst of the faults.
///
/// # Errors
///
/// Returns an error as [`play`] does.
pub fn play_with_stop(seed: u64, without: Option<Safeguard>) -> Result<TrialResult, TrialError> {
    play_trial(seed, without, Extra::Stop)
}

/// Plays a seed in which an agent keeps the history, and checks the history at the end.
///
/// # Errors
///
/// Returns an error as [`play`] does.
pub fn play_with_history(seed: u64) -> Result<TrialResult, TrialError> {
    play_trial(seed, None, Extra::History)
}

/// What a trial has besides the choices of its seed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Extra {
    None,
    Stop,
    History,
}

fn play_trial(
    seed: u64,
    without: Option<Safeguard>,
    extra: Extra,
) -> Result<TrialResult, TrialError> {
    let (runtime, folder) = (runtime()?, folder()?);
    runtime.block_on(async {
        let mut script = TrialScript::draw(seed)?;
        if extra == Extra::History {
            script.agents.push(chains::placement());
        }
        let stop = (extra == Extra::Stop).then(|| StopTrial::draw(&script));
        let city = Cluster::new(script, without, folder.path())?;
        Ok(Trial::new(city, stop, extra == Extra::History).play().await)
    })
}

/// Creates the runtime of a trial: one thread, and simulated time that advances when all tasks
/// wait.
pub(crate) fn runtime() -> std::io::Result<tokio::runtime::Runtime> {
    tokio::runtime::Builder::new_current_thread().enable_time().start_paused(true).build()
}

/// Creates a folder, in memory if possible: nothing here has to outlive this process.
pub(crate) fn folder() -> std::io::Result<tempfile::TempDir> {
    tempfile::tempdir_in("/dev/shm").or_else(|_| tempfile::tempdir())
}

struct Trial {
    city: Cluster,
    digest: Arc<Mutex<DefaultHasher>>,
    broken: Vec<String>,
    /// A stop of everything; `None` if the trial has none.
    stop: Option<StopTrial>,
    has_history: bool,
    chains: Option<ChainCounts>,
    since: Instant,
}

impl Trial {
    fn new(city: Cluster, stop: Option<StopTrial>, has_history: bool) -> Trial {
        let digest = Arc::new(Mutex::new(DefaultHasher::new()));
        let (heard, since) = (Arc::clone(&digest), Instant::now());
        if let Some(annex) = &city.world.annex {
            let heard = Arc::clone(&digest);
            annex.tap(move |from, addressed, payload| {
                let mut digest = heard.lock().unwrap_or_else(PoisonError::into_inner);
                (since.elapsed(), from.as_str(), format!("{addressed:?}")).hash(&mut *digest);
                payload.hash(&mut *digest);
            });
        }
        let (said, given) = (Arc::clone(&city.confirmations), Arc::clone(&city.command_log));
        city.world.network.tap(move |from, addressed, payload| {
            let mut digest = heard.lock().unwrap_or_else(PoisonError::into_inner);
            (since.elapsed(), from.as_str(), format!("{addressed:?}")).hash(&mut *digest);
            payload.hash(&mut *digest);
            said.record_confirmation(addressed, payload);
            given.record_command(addressed, payload);
            tracing::trace!(
                from = from.as_str(),
                ?addressed,
                "{}",
                String::from_utf8_lossy(payload)
            );
        });
        Trial { city, digest, broken: Vec::new(), stop, has_history, chains: None, since }
    }

    async fn play(mut self) -> TrialResult {
        for number in 0..self.city.machines.len() {
            self.city.start(number);
        }
        self.run_faults().await;
        self.city.recover_all();
        let settled = self.settle().await;
        for number in 0..self.city.machines.len() {
            self.city.read_begun(number);
        }
        let (goals, mailboxes) = (self.city.goals().await, self.city.mailboxes().await);
        let stopped = self.stop.iter().flat_map(StopTrial::violations);
        self.broken.extend(stopped.cloned());
        self.broken.extend(checks::all_violations(&self.city, &goals, &mailboxes, settled));
        if self.has_history {
            self.walk_chains().await;
        }
        self.into_trial_result()
    }

    /// Reads the whole history, and checks all its chains of causes.
    async fn walk_chains(&mut self) {
        let Some(terminal) = self.city.machines[0].start_keyboard(chains::READER) else { return };
        match chains::read(terminal).await {
            Ok(history) => {
                self.broken.extend(chains::violations(&history));
                self.chains = Some(chains::counts(&history, &self.city.begun));
            }
            Err(why) => self.broken.push(format!("the history cannot be read: {why}")),
        }
    }

    /// Requests goals and injects faults until the phase of faults is over.
    async fn run_faults(&mut self) {
        let mut wishes =
            self.city.world.script.scripted_goals.clone().into_iter().enumerate().peekable();
        let mut faults = self.city.world.script.faults.clone().into_iter().peekable();
        let mut errands = self.city.world.script.annex_requests_at.clone().into_iter().peekable();
        while self.city.now() < FAULTS_UNTIL {
            let next_wish = wishes.peek().map(|(_, wish)| wish.at);
            let next_fault = faults.peek().map(|(at, _)| *at);
            let next_errand = errands.peek().copied();
            let next =
                [next_wish, next_fault, next_errand, self.city.next_end(), Some(FAULTS_UNTIL)];
            let next = next.into_iter().flatten().min().unwrap_or(FAULTS_UNTIL);
            self.wait_until(next).await;
            let now = self.city.now();
            self.city.recover();
            while let Some((_, fault)) = faults.next_if(|(at, _)| *at <= now) {
                tracing::info!(?fault, "fault");
                self.city.inject(&fault);
            }
            while errands.next_if(|at| *at <= now).is_some() {
                self.city.ask_annex();
            }
            while let Some((number, wish)) = wishes.next_if(|(_, wish)| wish.at <= now) {
                let by = wish.by;
                tracing::info!(goal = wish.goal, by, "goal requested");
                if !self.city.people[by].request_goal(number, &wish) {
                    self.city.people[0].request_goal(number, &wish);
                }
            }
        }
    }

    /// Waits until all people have received their outcomes. Returns whether this happened in time.
    async fn settle(&mut self) -> bool {
        let until = self.city.now() + SETTLES_WITHIN;
        while self.city.now() < until {
            self.wait_until(self.city.now() + Duration::from_millis(500)).await;
            if self.stop.as_ref().is_some_and(|stop| !stop.is_over()) {
                continue;
            }
            let mut stories = self.city.people.iter().flat_map(|person| person.traces.values());
            if stories.all(|story| story.is_settled() || !story.is_listening)
                && checks::is_at_rest(&self.city.goals().await)
            {
                self.wait_until(self.city.now() + QUIET).await;
                self.await_leftover_plans(until).await;
                return true;
            }
        }
        false
    }

    /// Waits for plans that were given up while their executor was cut off: they may run to their
    /// end unobserved.
    async fn await_leftover_plans(&mut self, until: Duration) {
        while self.city.now() < until && !checks::surplus_exchanges(&self.city).is_empty() {
            self.wait_until(self.city.now() + QUIET).await;
        }
    }

    async fn wait_until(&mut self, at: Duration) {
        while self.city.now() < at {
            let look = (self.city.now() + LOOKS_EVERY).min(at);
            sleep_until(self.since + look).await;
            self.read_terminals();
        }
    }

    /// Reads all terminals. A goal that is reported as done must be true in the building.
    fn read_terminals(&mut self) {
        let truth = self.city.truth();
        for line in self.city.find_looped_proxy().into_iter().chain(self.city.overdue()) {
            if !self.broken.contains(&line) {
                self.broken.push(line);
            }
        }
        for person in &mut self.city.people {
            let before: Vec<_> = person.traces.values().map(|story| story.final_outcome).collect();
            person.read_reports();
            for (story, before) in person.traces.values().zip(before) {
                let is_told = before != story.final_outcome
                    && matches!(story.final_outcome, Some(Outcome::Done | Outcome::Holds));
                let unread = story.wish.rooms.iter().find(|room| !truth.was_read(room));
                if is_told && let Some(room) = unread {
                    let goal = &story.wish.goal;
                    self.broken.push(format!("{goal} is said to hold, and {room} was never read"));
                }
            }
        }
        if let (Some(stop), Some(person)) = (&mut self.stop, self.city.people.first_mut()) {
            stop.advance(self.since.elapsed(), person, &truth);
        }
    }

    fn into_trial_result(self) -> TrialResult {
        let Trial { city, digest, broken, chains, .. } = self;
        let mut story = Vec::new();
        for person in &city.people {
            for known in person.traces.values() {
                let (wish, who) = (&known.wish, &person.name);
                let listens = if known.is_listening { "" } else { ", terminal killed" };
                story.push(format!(
                    "{who}{listens}: {} ({:?}, {:?}), {:?}",
                    wish.goal, wish.keep, wish.partition, known.conversation
                ));
                story.extend(
                    known.received.iter().map(|(at, line)| format!("  {at:>10.3?} {line}")),
                );
            }
        }
        let script = &city.world.script;
        TrialResult {
            seed: script.seed,
            broken,
            effects: city.effects(),
            goals: GoalCounts::of(&city),
            digest: digest.lock().unwrap_or_else(PoisonError::into_inner).finish(),
            size: [
                script.daemons.len(),
                script.agents.len() + city.people.len(),
                script.scripted_goals.len(),
                script.faults.len(),
            ],
            lasted: city.now(),
            transcript: story,
            chains,
        }
    }
}

// === impl GoalCounts ===

impl GoalCounts {
    fn of(city: &Cluster) -> GoalCounts {
        let stories = city.people.iter().flat_map(|person| person.traces.values());
        let mut goals = GoalCounts::default();
        for story in stories.filter(|story| story.is_listening) {
            goals.asked += 1;
            goals.accepted += usize::from(story.is_accepted);
            let is_achieved = matches!(story.final_outcome, Some(Outcome::Done | Outcome::Holds));
            goals.achieved += usize::from(is_achieved);
        }
        goals
    }
}

impl std::ops::AddAssign for GoalCounts {
    fn add_assign(&mut self, other: GoalCounts) {
        let GoalCounts { asked, accepted, achieved } = other;
        self.asked += asked;
        self.accepted += accepted;
        self.achieved += achieved;
    }
}
