//! What an agent of this daemon said last of itself, for those who ask and have missed it.

use acl::Message;
use acl::content::{Inform, value};
use bytes::Bytes;

/// An agent's model, and its heartbeat if one came after it.
#[derive(Default)]
pub(crate) struct LastWord {
    model: Option<Bytes>,
    heartbeat: Option<Bytes>,
}

impl LastWord {
    /// It has told its model, or what is so now.
    pub(crate) fn told(&mut self, payload: &Bytes, is_model: bool) {
        // A copy of its own: a message is written into more room than it needs.
        let said = Some(Bytes::copy_from_slice(payload));
        match is_model {
            true => (self.model, self.heartbeat) = (said, None),
            false => self.heartbeat = said,
        }
    }

    /// Its model, brought up to its last heartbeat: who asks would otherwise believe what was so when
    /// the agent began.
    pub(crate) fn model(&mut self) -> Option<Bytes> {
        if let Some(heartbeat) = self.heartbeat.take()
            && let Some(renewed) = self.model.as_ref().and_then(|model| renew(model, &heartbeat))
        {
            self.model = Some(renewed);
        }
        self.model.clone()
    }
}

/// A model with a later heartbeat in it.
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
