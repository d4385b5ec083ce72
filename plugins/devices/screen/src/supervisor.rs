//! Keeps the program of a screen running, and checks every second what it shows. A connection to a
//! device that shows media is kept in the same way; it is called the program, too.
//!
//! - The program is started when the screen is first used, and again when it has ended, with pauses
//!   that grow.
//! - One task owns the program. Dropping the driver ends the task and the program.
//! - If a medium is no longer shown, the supervisor reports this and darkens the screen; a plan
//!   decides what is shown next.

use std::sync::{Arc, OnceLock};
use std::time::Duration;

use actuator::BoxFuture;
use tokio::sync::{mpsc, oneshot, watch};
use tokio::time::{Instant, MissedTickBehavior, interval, sleep_until};

use crate::content::Content;
use crate::player::{Player, PlayerTrouble};
use crate::{Display, DisplayState};

/// Pause between two checks of the program. The pause is short, so that a meeting can continue at
/// another screen within a few seconds.
const ASKING: Duration = Duration::from_secs(1);

/// Pause before the program is started again for the first time.
const PAUSE_FIRST: Duration = Duration::from_secs(1);

/// Longest pause before the program is started again. A display that is switched on in the morning
/// is used within a minute.
const PAUSE_MAX: Duration = Duration::from_secs(60);

/// Running time after which a program counts as sound, and the pauses begin anew.
const SOUND_AFTER: Duration = Duration::from_secs(60);

/// Time for a program that does not answer to end. It is longer than the time for which
/// [`Player::failed`] waits for the reason of a program that has ended.
const ENDING: Duration = Duration::from_secs(2);

/// Capacity of the queue of requests. An actuator runs one method at a time.
const WAITING_MAX: usize = 4;

/// The channel of a screen of this machine, which has a channel of its own.
const CHANNEL: u32 = 1;

/// A request to the task that owns the program.
struct ScreenRequest {
    what: Wanted,
    answer: oneshot::Sender<Result<(), String>>,
}

enum Wanted {
    Allocate,
    Show(Option<Content>),
}

/// The state of the screen, or the reason why it does not work.
type ScreenReport = Result<DisplayState, String>;

struct Supervised<P: Player> {
    /// Name of the screen, for the log.
    screen: String,
    settings: P::Settings,
    task: OnceLock<(mpsc::Sender<ScreenRequest>, watch::Receiver<ScreenReport>)>,
}

/// Returns the driver of the screen named `screen`. Nothing is started before it is used.
pub(crate) fn display<P: Player>(screen: &str, settings: P::Settings) -> Arc<dyn Display> {
    let screen = screen.to_owned();
    Arc::new(Supervised::<P> { screen, settings, task: OnceLock::new() })
}

impl<P: Player> Supervised<P> {
    /// Returns the connection to the task. Starts the task at the first use.
    fn task(&self) -> &(mpsc::Sender<ScreenRequest>, watch::Receiver<ScreenReport>) {
        self.task.get_or_init(|| {
            let (requests, requested) = mpsc::channel(WAITING_MAX);
            let (state, seen) = watch::channel(Err("wait for the start of its program".to_owned()));
            let supervision = Supervision::<P> {
                screen: self.screen.clone(),
                settings: self.settings.clone(),
                requested,
                state,
                is_allocated: false,
            };
            tokio::spawn(supervision.run());
            (requests, seen)
        })
    }

    fn request(&self, what: Wanted) -> BoxFuture<Result<(), String>> {
        let requests = self.task().0.clone();
        Box::pin(async move {
            let (answer, answered) = oneshot::channel();
            let gone = || "reach the program of the screen: it is being ended".to_owned();
            requests.send(ScreenRequest { what, answer }).await.map_err(|_| gone())?;
            answered.await.map_err(|_| gone())?
        })
    }
}

impl<P: Player> Display for Supervised<P> {
    fn allocate(&self) -> BoxFuture<Result<u32, String>> {
        let allocated = self.request(Wanted::Allocate);
        Box::pin(async move { allocated.await.map(|()| CHANNEL) })
    }

    fn show(&self, content: Option<&Content>) -> BoxFuture<Result<(), String>> {
        self.request(Wanted::Show(content.cloned()))
    }

    fn panel(&self) -> BoxFuture<ScreenReport> {
        let state = self.task().1.borrow().clone();
        Box::pin(std::future::ready(state))
    }
}

/// The task that owns the program.
struct Supervision<P: Player> {
    screen: String,
    settings: P::Settings,
    requested: mpsc::Receiver<ScreenRequest>,
    state: watch::Sender<ScreenReport>,
    is_allocated: bool,
}

impl<P: Player> Supervision<P> {
    /// Runs the program until the driver is dropped; starts it again each time that it ends.
    async fn run(mut self) {
        let mut pause = PAUSE_FIRST;
        loop {
            let began = Instant::now();
            let started = tokio::select! {
                started = P::start(&self.settings) => started,
                () = self.state.closed() => return,
            };
            let reason = match started {
                Err(reason) => reason,
                Ok(mut player) => {
                    let reason = self.serve(&mut player).await;
                    if let Some(reason) = &reason {
                        drop(self.state.send_replace(Err(reason.clone())));
                    }
                    player.end().await;
                    match reason {
                        None => return,
                        Some(reason) => reason,
                    }
                }
            };
            if began.elapsed() >= SOUND_AFTER {
                pause = PAUSE_FIRST;
            }
            let screen = self.screen.as_str();
            tracing::warn!(screen, "failed to {reason}; the next attempt is in {pause:?}");
            if !self.rest(pause, &reason).await {
                return;
            }
            pause = (pause * 2).min(PAUSE_MAX);
        }
    }

    /// Waits before the next start. Meanwhile answers requests with `reason`. Returns `false` if
    /// the driver is dropped.
    async fn rest(&mut self, pause: Duration, reason: &str) -> bool {
        drop(self.state.send_replace(Err(reason.to_owned())));
        let until = Instant::now() + pause;
        loop {
            tokio::select! {
                () = sleep_until(until) => return true,
                request = self.requested.recv() => match request {
                    None => return false,
                    // The requester may have given up.
                    Some(request) => drop(request.answer.send(Err(reason.to_owned()))),
                },
            }
        }
    }

    /// Serves requests and watches the program. Returns the reason why the program has to be
    /// started again; `None` if the driver is dropped.
    async fn serve(&mut self, player: &mut P) -> Option<String> {
        let mut shown = None;
        let mut asking = interval(ASKING);
        asking.set_missed_tick_behavior(MissedTickBehavior::Delay);
        loop {
            self.publish(&shown);
            let (done, answer) = tokio::select! {
                biased;
                reason = player.failed() => return Some(reason),
                request = self.requested.recv() => {
                    let ScreenRequest { what, answer } = request?;
                    let done = match what {
                        Wanted::Allocate => {
                            self.is_allocated = true;
                            Ok(())
                        }
                        Wanted::Show(content) => {
                            let done = player.show(content.as_ref()).await;
                            shown = content;
                            done
                        }
                    };
                    (done, Some(answer))
                }
                _ = asking.tick() => (player.check().await, None),
            };
            let told = done.clone().map_err(PlayerTrouble::into_reason);
            let restart = match done {
                Ok(()) => None,
                Err(trouble) => {
                    shown = None;
                    self.recover(player, trouble).await
                }
            };
            // The screen is dark and the state is published before the answer, so that no check in
            // between finds the state from before.
            if restart.is_none() {
                self.publish(&shown);
            }
            if let Some(answer) = answer {
                // The requester may have given up.
                let _ = answer.send(told);
            }
            if restart.is_some() {
                return restart;
            }
        }
    }

    /// Darkens the screen if its medium cannot be shown. Returns the reason why the program has to
    /// be started again; `None` if the program works.
    async fn recover(&self, player: &mut P, trouble: PlayerTrouble) -> Option<String> {
        let lost = match trouble {
            PlayerTrouble::Program(reason) => reason,
            PlayerTrouble::Content(reason) => {
                let screen = self.screen.as_str();
                tracing::warn!(screen, "the screen is dark: failed to {reason}");
                player.show(None).await.err()?.into_reason()
            }
        };
        // The screen offers nothing from now on.
        drop(self.state.send_replace(Err(lost.clone())));
        // A program that has just ended gives a more precise reason than its connection.
        let ended = tokio::time::timeout(ENDING, player.failed()).await;
        Some(ended.unwrap_or(lost))
    }

    fn publish(&self, shown: &Option<Content>) {
        let shown = shown.as_ref().map(|content| content.written().to_owned());
        let channel = self.is_allocated.then_some(CHANNEL);
        drop(self.state.send_replace(Ok(DisplayState { channel, shown })));
    }
}

impl PlayerTrouble {
    fn into_reason(self) -> String {
        match self {
            PlayerTrouble::Content(reason) | PlayerTrouble::Program(reason) => reason,
        }
    }
}
