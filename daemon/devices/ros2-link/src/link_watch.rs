//! Decides whether the other end of a link is in reach. Zenoh tells by no event that a link is lost
//! or restored, so the link is looked at again and again.

use std::time::Duration;

use tokio::sync::watch;
use tokio::time::Instant;
use tokio_util::task::AbortOnDropHandle;

use crate::link::RosLink;

/// Interval at which a link is looked at.
const LOOKED_EVERY: Duration = Duration::from_millis(250);

/// How long a link may be missing before the other end counts as out of reach. A robot that changes
/// its access point is away for some seconds.
const LOST_AFTER: Duration = Duration::from_secs(5);

/// Whether the other end of a link is in reach.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LinkReach {
    /// There was no link yet, and it is too early to give it up.
    Opening,
    /// There is a link, or there was one a moment ago.
    Reached,
    /// There is no link, and there was none for a while.
    Lost,
}

/// A watch over one link, which ends when it is dropped.
pub struct LinkWatch {
    state: watch::Receiver<LinkReach>,
    _watching: AbortOnDropHandle<()>,
}

impl LinkWatch {
    /// Begins to watch a link. `agent` is the name of the agent that uses it, for the log. Must be
    /// called within a Tokio runtime.
    pub fn start(link: RosLink, agent: &str) -> LinkWatch {
        let (sender, state) = watch::channel(LinkReach::Opening);
        let watching = tokio::spawn(watch_link(link, agent.to_owned(), sender));
        LinkWatch { state, _watching: AbortOnDropHandle::new(watching) }
    }

    /// Returns a receiver of the state, which is notified of each change.
    pub fn state(&self) -> watch::Receiver<LinkReach> {
        self.state.clone()
    }
}

/// Looks at a link until the task is aborted.
async fn watch_link(link: RosLink, agent: String, state: watch::Sender<LinkReach>) {
    let mut judge = LinkJudge::new(Instant::now());
    loop {
        let linked = link.until_linked(Duration::ZERO).await;
        let judged = judge.look(linked.is_ok(), Instant::now());
        if state.send_if_modified(|state| std::mem::replace(state, judged) != judged) {
            match (judged, linked) {
                (LinkReach::Lost, Err(error)) => {
                    tracing::warn!(
                        agent,
                        "it offers no actions until the link is back: failed to \
                        {error}"
                    );
                }
                _ => tracing::info!(agent, "it is linked to its device"),
            }
        }
        tokio::time::sleep(LOOKED_EVERY).await;
    }
}

/// The state of a link, from what each look has found.
struct LinkJudge {
    state: LinkReach,
    /// When the link was seen last, or the watch began.
    seen_at: Instant,
}

impl LinkJudge {
    fn new(now: Instant) -> LinkJudge {
        LinkJudge { state: LinkReach::Opening, seen_at: now }
    }

    fn look(&mut self, is_linked: bool, now: Instant) -> LinkReach {
        if is_linked {
            (self.state, self.seen_at) = (LinkReach::Reached, now);
        } else if now.saturating_duration_since(self.seen_at) >= LOST_AFTER {
            self.state = LinkReach::Lost;
        }
        self.state
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the states after looks that found a link or none, each at its second.
    fn states(looks: &[(u64, bool)]) -> Vec<LinkReach> {
        let start = Instant::now();
        let mut judge = LinkJudge::new(start);
        let look = |(second, is_linked): &(u64, bool)| {
            judge.look(*is_linked, start + Duration::from_secs(*second))
        };
        looks.iter().map(look).collect()
    }

    #[test]
    fn a_link_that_is_missing_for_a_while_is_lost_until_it_is_back() {
        use LinkReach::{Lost, Opening, Reached};
        assert_eq!(states(&[(0, false), (4, false), (5, false)]), [Opening, Opening, Lost]);
        assert_eq!(states(&[(0, false), (1, true), (5, false)]), [Opening, Reached, Reached]);
        assert_eq!(states(&[(1, true), (6, false), (7, true)]), [Reached, Lost, Reached]);
        // A link that breaks again and again for a moment stays reached.
        assert_eq!(states(&[(1, true), (4, false), (5, true), (9, false)]), [Reached; 4]);
    }
}
