//! Latest announcement of an agent of this daemon, for other agents that have missed it.

use acl::Message;
use acl::content::{Inform, value};
use bytes::Bytes;

/// The last model that an agent has announced, and the agent's last heartbeat if one was sent after
/// the model.
#[derive(Default)]
pub(crate) struct LatestAnnouncement {
    model: Option<Bytes>,
    heartbeat: Option<Bytes>,
}

impl LatestAnnouncement {
    /// Stores a model or a heartbeat that the agent has sent.
    pub(crate) fn record(&mut self, payload: &Bytes, is_model: bool) {
        // Copied, because the buffer of an encoded message is larger than its content.
        let said = Some(Bytes::copy_from_slice(payload));
        match is_model {
            true => (self.model, self.heartbeat) = (said, None),
            false => self.heartbeat = said,
        }
    }

    /// Returns the announced model, updated by the last heartbeat. Without the update the receiver
    /// would believe the facts of the time when the agent started. `None` if the agent has
    /// announced no model.
    pub(crate) fn model(&mut self) -> Option<Bytes> {
        if let Some(heartbeat) = self.heartbeat.take()
            && let Some(renewed) = self.model.as_ref().and_then(|model| renew(model, &heartbeat))
        {
            self.model = Some(renewed);
        }
        self.model.clone()
    }
}

/// Returns the announcement of the model with its heartbeat replaced by a later one; `None` if
/// either message cannot be read.
fn renew(model: &Bytes, heartbeat: &Bytes) -> Option<Bytes> {
    let (model, heartbeat) = (acl::decode(model).ok()?, acl::decode(heartbeat).ok()?);
    let (Inform::Model(mut announced), Inform::Heartbeat(heartbeat)) =
        (model.content_as().ok()?, heartbeat.content_as().ok()?)
    else {
        return None;
    };
    announced.heartbeat = heartbeat;
    Some(acl::encode(&Message { content: value(&Inform::Model(announced)), ..model }))
}
