//! The feed of a view: a guest's link to a running ecosystem, through which it is observed. If no
//! daemon is reached, the feed says so, and connects again by itself.

use std::sync::Arc;
use std::time::Duration;

use acl::EcosystemId;
use live_view::ViewEvent;
use substrate::OverhearToken;
use tokio::time::timeout;

use super::view_inbox::ViewInbox;
use crate::cli::ReachArgs;
use crate::commands::client::{ClientLink, ClientTarget};
use crate::config::Ecosystem;
use crate::observing::{self, FollowEnd, ObserverPlace, PollHints, push};

/// How long connecting may take until it is tried again.
const OPENED_WITHIN: Duration = Duration::from_secs(15);

/// How long to wait until connecting is tried again. A daemon that is started is seen within this
/// time, and looking for its socket costs almost nothing.
const OPENED_AGAIN_AFTER: Duration = Duration::from_secs(1);

/// The ecosystem that a feed observes.
#[derive(Clone)]
pub(super) struct FeedSource {
    pub(super) name: EcosystemId,
    pub(super) ecosystem: Option<Ecosystem>,
    pub(super) reach: ReachArgs,
}

/// The connection of a feed to an ecosystem: a guest's link, which also hears all messages.
struct FeedLink {
    link: ClientLink,
    _listening: OverhearToken,
    hints: Arc<PollHints>,
}

/// Observes an ecosystem for ever. While nobody reads the terminal, the link is closed: what is not
/// seen costs the ecosystem nothing.
pub(super) async fn observe(source: FeedSource, inbox: Arc<ViewInbox>) {
    push(&*inbox, observing::expected(source.ecosystem.as_ref()));
    loop {
        match timeout(OPENED_WITHIN, open(&source, &inbox)).await {
            Ok(Ok(feed)) => {
                push(&*inbox, ViewEvent::Reached(true));
                let view = &feed.link.view;
                let place = ObserverPlace::Guest;
                let end = observing::follow(view, place, &feed.hints, &inbox).await;
                if end == FollowEnd::Unseen {
                    push(&*inbox, ViewEvent::Reached(false));
                }
                feed.link.node.drain().await;
                if end == FollowEnd::Unread {
                    let since = observing::now();
                    inbox.taken().await;
                    push(&*inbox, ViewEvent::Unread { since });
                    continue;
                }
            }
            Ok(Err(problem)) => {
                tracing::debug!("failed to {problem}");
                push(&*inbox, ViewEvent::Reached(false));
            }
            Err(_) => push(&*inbox, ViewEvent::Reached(false)),
        }
        tokio::time::sleep(OPENED_AGAIN_AFTER).await;
    }
}

async fn open(source: &FeedSource, inbox: &Arc<ViewInbox>) -> Result<FeedLink, String> {
    let FeedSource { name, ecosystem, reach } = source.clone();
    let target = ClientTarget::named(name, ecosystem, &reach)?;
    // Waiting for the turn blocks this thread, which other tasks must not need meanwhile.
    let turn = tokio::task::block_in_place(|| target.turn())?;
    let hints = Arc::new(PollHints::default());
    let link = target.link().await?;
    let listening =
        observing::listen(&link.node, inbox, &hints).map_err(|error| error.to_string())?;
    drop(turn);
    Ok(FeedLink { link, _listening: listening, hints })
}
