//! One channel: its rules, the form of its notices, and how they reach the person behind it.

use std::sync::Arc;

use crate::channel_rules::ChannelRules;
use crate::mail::MailRelay;
use crate::notice::NoticeDelivery;
use crate::ntfy::NtfyTopic;
use crate::send_failure::SendFailure;
use crate::sentences::NoticeForm;
use crate::web_push::WebPush;
use crate::webhook::Webhook;

/// A channel, as the ecosystem file describes it.
#[derive(Clone)]
pub(crate) struct NotifierChannel {
    /// Name for the log: the number in `to` and the kind. Addresses may be secrets.
    pub(crate) name: String,
    pub(crate) rules: ChannelRules,
    pub(crate) form: NoticeForm,
    pub(crate) target: ChannelTarget,
}

/// The receiver of a channel, with all that is needed to reach it.
#[derive(Clone)]
pub(crate) enum ChannelTarget {
    /// A program that takes JSON by HTTP.
    Webhook(Arc<Webhook>),
    /// A topic of a server of ntfy.
    Ntfy(Arc<NtfyTopic>),
    /// Addresses behind a mail relay.
    Mail(Arc<MailRelay>),
    /// The browsers that have subscribed.
    WebPush(Arc<WebPush>),
}

// === impl NotifierChannel ===

impl NotifierChannel {
    /// Returns the store of subscriptions, if the channel has one.
    pub(crate) fn push(&self) -> Option<Arc<WebPush>> {
        match &self.target {
            ChannelTarget::WebPush(push) => Some(Arc::clone(push)),
            _ => None,
        }
    }
}

// === impl ChannelTarget ===

impl ChannelTarget {
    /// Sends a delivery once, within a deadline.
    pub(crate) async fn send(
        self,
        delivery: NoticeDelivery,
        form: NoticeForm,
    ) -> Result<(), SendFailure> {
        match self {
            ChannelTarget::Webhook(webhook) => webhook.send(&delivery, &form).await,
            ChannelTarget::Ntfy(topic) => topic.send(&delivery, &form).await,
            ChannelTarget::Mail(relay) => relay.send(&delivery, &form).await,
            ChannelTarget::WebPush(push) => push.send(&delivery, &form).await,
        }
    }
}
