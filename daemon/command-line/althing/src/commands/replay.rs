//! `althing replay`: sends the requests of a recording again, to newly started agents.
//!
//! - Messages of the recorded ecosystem's own agents are not replayed: those agents run here, and
//!   send messages of their own. Only exchanges that other agents opened are replayed: the goals,
//!   actions and changes that people requested (`replay_plan`).
//! - The agents run in this process, on a network in memory, with a simulated building of their
//!   own; `--lose` and `--duplicate` make that network unreliable.
//! - A request that was made after another request had ended is replayed after the other one has
//!   ended.
//! - The end of each exchange is compared with the end of the same exchange in the recording.

mod replay_plan;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use acl::content::Outcome;
use acl::{AgentId, ConversationId, DaemonId};
use keyboard::{Keyboard, MessageDraft, UserRequest};
use serde_json::json;
use substrate::memory::Network;
use tokio::sync::watch;
use tokio::time::Instant;

use crate::cli::ReplayArgs;
use crate::commands::brief;
use crate::commands::watch::record::Recording;
use crate::config::{self, Ecosystem, Overrides};
use crate::hosting::{self, DaemonNode, FaultInjector, MessageTransport, NodeOptions};
use crate::interfacing::remote_client::{RemoteClient, RemoteUpdate};
use crate::interruption;
use crate::plugins;
use replay_plan::{ExchangeEnd, OpeningMessage, ReplayPlan, ReplayedExchange};
use terminal::render::plural;
use terminal::{exit, output};

/// Exit code if an exchange ended in another way than in the recording.
const DIFFERENT_END: u8 = 1;

/// Runs `althing replay`: replays a recording, and prints the results.
pub(super) fn run(args: &ReplayArgs) -> ExitCode {
    let json = args.print.json;
    let recording = match Recording::read(&args.file) {
        Ok(recording) => recording,
        Err(error) => return super::wrong(&format!("failed to {error}"), json),
    };
    let ecosystem = match ecosystem(args) {
        Ok(ecosystem) => ecosystem,
        Err(code) => return code,
    };
    if ecosystem.name != recording.header.ecosystem {
        output::print_note(&format!(
            "warning: the recording is of `{}`, and is replayed in `{}`",
            recording.header.ecosystem, ecosystem.name
        ));
    }
    let plays = ReplayPlan::of(&recording, &ecosystem);
    let mishaps = Arc::new(FaultInjector::new(args.lose, args.duplicate, args.seed));
    let lasts = recording.lasts();
    let (speed, name) = (args.speed, args.file.display().to_string());
    let patience = Duration::from_secs(args.patience.into());
    super::in_runtime(async move {
        let unread = recording.unread;
        let show = ReplaySession { plays, mishaps, speed, lasts, patience, unread, name };
        tokio::select! {
            played = show.play(&ecosystem, json) => match played {
                Ok(code) => code,
                Err(problem) => {
                    output::print_note(&format!("error: failed to {problem}"));
                    exit::with(exit::UNAVAILABLE)
                }
            },
            signal = interruption::interrupted() => exit::by_signal(signal),
        }
    })
}

fn ecosystem(args: &ReplayArgs) -> Result<Ecosystem, ExitCode> {
    let file = match &args.ecosystem {
        Some(asked) => config::resolve_ecosystem(asked).map_err(|problem| {
            output::print_note(&format!("error: failed to {problem}"));
            exit::with(exit::CONFIG)
        })?,
        None => config::find_ecosystem_file().unwrap_or_else(|| PathBuf::from("althing.toml")),
    };
    let loaded = Ecosystem::load(&file, &Overrides::default(), &plugins::known());
    let mut ecosystem = loaded.map_err(|error| {
        output::show(&error.into_report(), args.print.json, "bad-input", exit::CONFIG)
    })?;
    ecosystem.building.time_scale /= args.speed;
    Ok(ecosystem)
}

/// A recording and the options with which it is replayed.
struct ReplaySession {
    plays: ReplayPlan,
    mishaps: Arc<FaultInjector>,
    speed: f64,
    lasts: Duration,
    /// How long to wait for the end of an exchange beyond the time that it took in the recording. A
    /// lost message is resent up to a second later, and a plan has tens of messages.
    patience: Duration,
    unread: usize,
    name: String,
}

/// Maps each conversation of the recording to the conversation of the replay that stands for it.
type ConversationMap = Arc<watch::Sender<BTreeMap<ConversationId, ConversationId>>>;

impl ReplaySession {
    /// Replays the recording to its end. The error text completes the sentence “failed to …”.
    async fn play(self, ecosystem: &Ecosystem, json: bool) -> Result<ExitCode, String> {
        // The state folder of the fresh ecosystem exists as long as the replay.
        let state = tempfile::Builder::new().prefix("althing-").tempdir();
        let state = state.map_err(|error| format!("make a folder for the replay: {error}"))?;
        let node = self.open(ecosystem, state.path()).await?;
        // Waits for heartbeats, so that all agents know each other as in the recording.
        tokio::time::sleep(ecosystem.settings.heartbeat_period * 2).await;
        let began = Instant::now();
        let voices = self.launch_clients(&node, ecosystem);
        let (now, ended) =
            (ConversationMap::default(), Arc::new(watch::Sender::new(BTreeSet::new())));
        let mut running = tokio::task::JoinSet::new();
        for (index, play) in self.plays.plays.iter().enumerate() {
            let Some(voice) = voices.get(&keyboard_name(index, play)).cloned() else { continue };
            let wait = Duration::from_millis(play.after_ms).div_f64(self.speed);
            let until = began + self.lasts.div_f64(self.speed) + self.patience;
            let (play, now, ended) = (play.clone(), Arc::clone(&now), Arc::clone(&ended));
            running.spawn(async move {
                let mut others = ended.subscribe();
                let is_its_turn =
                    |ended: &BTreeSet<usize>| play.after.iter().all(|it| ended.contains(it));
                tokio::time::sleep(wait).await;
                // If earlier requests have not ended by `until`, this one is replayed all the same.
                let _ = tokio::time::timeout_at(until, others.wait_for(is_its_turn)).await;
                let has_ended = || {
                    ended.send_modify(|ended| {
                        ended.insert(index);
                    });
                };
                let end = replay_exchange(play.clone(), voice, now, until, has_ended).await;
                has_ended();
                (index, end)
            });
        }
        let mut ends = vec![ExchangeEnd::Open; self.plays.plays.len()];
        while let Some(ended) = running.join_next().await {
            let (index, end) = ended.map_err(|error| error.to_string())?;
            ends[index] = end;
        }
        let took = began.elapsed();
        node.drain().await;
        Ok(self.tell(&ends, took, json))
    }

    async fn open(&self, ecosystem: &Ecosystem, state: &Path) -> Result<DaemonNode, String> {
        let building = hosting::simulate(ecosystem).map_err(|error| error.to_string())?;
        let part = NodeOptions {
            ecosystem,
            daemon: DaemonId::new("replay").map_err(|error| error.to_string())?,
            agents: ecosystem.agents.clone(),
            mode: ecosystem.mode,
            building: Some(building.handle()),
            state: Some(state.to_owned()),
        };
        let wire = MessageTransport::Unreliable(Network::new(), Arc::clone(&self.mishaps));
        DaemonNode::open(part, wire).await.map_err(|error| error.to_string())
    }

    /// Launches a keyboard agent for every initiator in the recording, under the name that the
    /// initiator has in the recording.
    fn launch_clients(
        &self,
        node: &DaemonNode,
        ecosystem: &Ecosystem,
    ) -> BTreeMap<AgentId, RemoteClient> {
        let mut voices = BTreeMap::new();
        for (index, play) in self.plays.plays.iter().enumerate() {
            voices.entry(keyboard_name(index, play)).or_insert_with_key(|who| {
                let (keyboard, terminal) = Keyboard::with_terminal();
                node.launch(who.clone(), keyboard, ecosystem.domain.name.as_str());
                let (voice, speaking) = RemoteClient::new(terminal);
                tokio::spawn(speaking);
                voice
            });
        }
        voices
    }

    fn tell(&self, ends: &[ExchangeEnd], took: Duration, json: bool) -> ExitCode {
        let plays = &self.plays.plays;
        let is_same = |(play, end): (&ReplayedExchange, &ExchangeEnd)| play.end.is_as_good_as(*end);
        let otherwise = plays.iter().zip(ends).filter(|pair| !is_same(*pair)).count();
        let code = if otherwise == 0 { exit::DONE } else { DIFFERENT_END };
        let count = |counter: &std::sync::atomic::AtomicU64| counter.load(Ordering::Relaxed);
        let FaultInjector { lost, doubled, all, .. } = &*self.mishaps;
        let (lost, doubled, all) = (count(lost), count(doubled), count(all));
        if json {
            let played: Vec<_> = { plays.iter().zip(ends) }
                .map(|(play, end)| {
                    json!({
                        "who": play.who,
                        "said": play.words.to_string(),
                        "then": play.end.to_string(),
                        "now": end.to_string(),
                        "same": play.end.is_as_good_as(*end),
                    })
                })
                .collect();
            let value = json!({
                "status": if otherwise == 0 { "same" } else { "otherwise" },
                "plays": played,
                "left-out": self.plays.left_out,
                "unread": self.unread,
                "messages": { "all": all, "lost": lost, "twice": doubled },
                "seconds": took.as_secs_f64(),
            });
            return output::print_json(&value, code);
        }
        let mut text = String::new();
        for (play, end) in plays.iter().zip(ends) {
            let mark = if is_same((play, end)) { '✓' } else { '✗' };
            text += &format!(
                "{mark} {}: {}\n  recorded: {}, now: {end}\n",
                play.who, play.words, play.end
            );
        }
        let left_out = plural(self.plays.left_out, "message");
        text += &format!(
            "{} of {} replayed from {} in {}; {left_out} left out\n",
            plays.len(),
            plural(plays.len(), "request"),
            self.name,
            brief(took)
        );
        if self.mishaps.lose > 0.0 || self.mishaps.duplicate > 0.0 {
            let seed = self.mishaps.seed;
            text += &format!("{lost} of {all} messages lost, {doubled} doubled (--seed {seed})\n");
        }
        text += &match otherwise {
            0 => "all ended as recorded\n".to_owned(),
            count => format!("{count} did not end as recorded\n"),
        };
        output::print(text, code)
    }
}

/// Returns the name of the keyboard agent that sends the message of a replayed exchange. A
/// cancellation has its own keyboard, because the answers to it arrive in the conversation of the
/// goal, as the answers to the goal's initiator do.
fn keyboard_name(index: usize, play: &ReplayedExchange) -> AgentId {
    match &play.words {
        OpeningMessage::Said(_) => play.who.clone(),
        OpeningMessage::CancelEarlier(..) => AgentId::new(&format!("replay-gives-up-{index}"))
            .expect("invariant: letters, digits and dashes are a name"),
    }
}

/// Replays one exchange, and returns how it ended. Calls `has_ended` as soon as a kept goal holds
/// for the first time, because in the recording a later cancellation did not wait longer either.
async fn replay_exchange(
    play: ReplayedExchange,
    voice: RemoteClient,
    now: ConversationMap,
    until: Instant,
    has_ended: impl Fn(),
) -> ExchangeEnd {
    let said = match play.words {
        OpeningMessage::Said(said) => said,
        OpeningMessage::CancelEarlier(then, draft) => {
            let conversation = Some(conversation_now(&now, then, until).await);
            UserRequest::Send(MessageDraft { conversation, ..draft })
        }
    };
    let mut asked = voice.send_request(said, false, None).await;
    let mut end = ExchangeEnd::Open;
    let hearing = async {
        loop {
            let news = asked.next().await;
            if let Some(conversation) = asked.conversation() {
                now.send_modify(|now| {
                    now.insert(play.conversation.clone(), conversation.clone());
                });
            }
            let is_final = news.is_final();
            if let Some(heard) = ExchangeEnd::of(&news) {
                end = heard;
                has_ended();
            }
            // A kept goal that held in the recording is followed only until it holds.
            if is_final || (end == ExchangeEnd::Done && play.end == ExchangeEnd::Done) {
                return;
            }
        }
    };
    // An exchange without an end at `until` counts as open.
    let _ = tokio::time::timeout_at(until, hearing).await;
    end
}

/// Returns the conversation of the replay that stands for the recorded conversation `then`. Waits
/// for it up to the time `until`. If there is none by then, returns `then` itself, which no agent
/// here uses.
async fn conversation_now(
    now: &ConversationMap,
    then: ConversationId,
    until: Instant,
) -> ConversationId {
    let mut known = now.subscribe();
    let asked = tokio::time::timeout_at(until, known.wait_for(|now| now.contains_key(&then)));
    match asked.await {
        Ok(Ok(now)) => now.get(&then).cloned().unwrap_or(then),
        _ => then.clone(),
    }
}

impl ExchangeEnd {
    /// Returns the end of an exchange that a message reports; `None` if the message reports only
    /// progress.
    fn of(news: &RemoteUpdate) -> Option<ExchangeEnd> {
        match news {
            RemoteUpdate::Report(report) => ExchangeEnd::of_outcome(report.outcome),
            RemoteUpdate::Refused(_) => Some(ExchangeEnd::Refused),
            RemoteUpdate::Unanswered | RemoteUpdate::DeadlinePassed(_) => {
                Some(ExchangeEnd::Unanswered)
            }
        }
    }

    fn of_outcome(outcome: Outcome) -> Option<ExchangeEnd> {
        match outcome {
            Outcome::Progress => None,
            Outcome::Holds | Outcome::Done => Some(ExchangeEnd::Done),
            Outcome::Failed => Some(ExchangeEnd::Failed),
            Outcome::Cancelled => Some(ExchangeEnd::Cancelled),
        }
    }
}
