//! Motion events of a camera, from a pull point of its service of events (WS-BaseNotification).

use std::sync::Arc;
use std::time::{Duration, Instant};

use crate::camera::OnvifCamera;
use crate::error::LinkError;
use crate::motion::{MotionMessage, MotionTracker};
use crate::services::EVENTS;
use crate::session::{CALL_TIME_MAX, Call};
use crate::soap::{Addressing, Operation};
use crate::xml::Element;

const PORT_TYPE: &str = "http://www.onvif.org/ver10/events/wsdl/PullPointSubscription";
const NOTIFICATION: &str = "http://docs.oasis-open.org/wsn/b-2";
const NOTIFICATION_ACTIONS: &str = "http://docs.oasis-open.org/wsn/bw-2";

/// Time that a camera may wait for a message before it answers; also in ONVIF's notation. Routers
/// forget connections that are idle for longer than half a minute.
const PULL_TIME: Duration = Duration::from_secs(20);
const PULL_TIME_TEXT: &str = "PT20S";

/// Requested duration of a subscription, in ONVIF's notation.
const SUBSCRIPTION_TEXT: &str = "PT10M";

/// Age at which a subscription is replaced by a new one. Many cameras fail to renew a subscription.
const SUBSCRIPTION_AGE_MAX: Duration = Duration::from_secs(480);

/// Interval between two requests for messages if the camera answers at once: some cameras do not wait
/// for messages, or have always one. The interval is shorter than a person notices.
const PULL_INTERVAL: Duration = Duration::from_millis(100);

/// Number of answers that may come at once before [`PULL_INTERVAL`] applies: motion begins and ends.
const QUICK_ANSWERS: u32 = 4;

/// Maximum number of messages in one answer.
const MESSAGES_MAX: &str = "32";

/// The motion events of a camera.
#[derive(Debug)]
pub struct MotionEvents {
    camera: Arc<OnvifCamera>,
    subscription: Option<Subscription>,
    tracker: MotionTracker,
    /// Time of the last request for messages.
    pulled_at: Option<Instant>,
    /// Number of answers in a row that came at once.
    quick_answers: u32,
}

#[derive(Clone, Debug)]
struct Subscription {
    /// Address as the camera has named it.
    named: String,
    at: crate::address::Address,
    parameters: Vec<Element>,
    since: Instant,
}

impl MotionEvents {
    /// Returns the motion events of `camera`. Subscribes at the first call of
    /// [`MotionEvents::next`].
    pub fn new(camera: &Arc<OnvifCamera>) -> MotionEvents {
        let camera = Arc::clone(camera);
        let (subscription, tracker) = (None, MotionTracker::default());
        MotionEvents { camera, subscription, tracker, pulled_at: None, quick_answers: 0 }
    }

    /// Waits for messages of the camera, at most for the time of one pull. Returns whether there is
    /// motion. After an error, the next call subscribes anew.
    ///
    /// # Errors
    ///
    /// Returns an error if the camera does not answer, or has no such events.
    pub async fn next(&mut self) -> Result<bool, LinkError> {
        let pulled = self.pull().await;
        if pulled.is_err() {
            self.abandon();
        }
        pulled?;
        Ok(self.is_motion())
    }

    /// Whether there is motion, by the messages so far.
    pub fn is_motion(&self) -> bool {
        self.tracker.is_motion(Instant::now())
    }

    /// Ends the subscription. Cameras have few of them, and keep each for minutes otherwise.
    pub async fn close(&mut self) {
        if let Some(subscription) = self.subscription.take() {
            unsubscribe(&self.camera, &subscription).await;
        }
    }

    /// Ends the subscription beside everything else, as far as the camera can be reached.
    fn abandon(&mut self) {
        let Some(subscription) = self.subscription.take() else { return };
        let Ok(runtime) = tokio::runtime::Handle::try_current() else { return };
        let camera = Arc::clone(&self.camera);
        runtime.spawn(async move { unsubscribe(&camera, &subscription).await });
    }

    async fn pull(&mut self) -> Result<(), LinkError> {
        let subscription = self.subscribed().await?;
        if self.tracker.is_due(Instant::now()) {
            self.synchronize(&subscription).await;
        }
        let content = format!(
            "<o:Timeout>{PULL_TIME_TEXT}</o:Timeout><o:MessageLimit>{MESSAGES_MAX}\
             </o:MessageLimit>"
        );
        let began = self.next_pull().await;
        let action = format!("{PORT_TYPE}/PullMessagesRequest");
        let operation = Operation { namespace: EVENTS, name: "PullMessages", action: &action };
        let answer = self
            .camera
            .session
            .call(&subscription.call(operation, &content, PULL_TIME + CALL_TIME_MAX))
            .await?;
        for notification in answer.all("NotificationMessage") {
            self.note(notification);
        }
        // The pause comes before the next request: what the camera has said is known at once.
        self.quick_answers =
            if began.elapsed() < PULL_INTERVAL { self.quick_answers.saturating_add(1) } else { 0 };
        self.pulled_at = Some(began);
        Ok(())
    }

    /// Waits until the next request for messages may be sent. Returns its time.
    async fn next_pull(&self) -> Instant {
        if let Some(pulled_at) = self.pulled_at
            && self.quick_answers >= QUICK_ANSWERS
        {
            tokio::time::sleep_until((pulled_at + PULL_INTERVAL).into()).await;
        }
        Instant::now()
    }

    fn note(&mut self, notification: &Element) {
        let Some(message) = MotionMessage::of(notification) else { return };
        // A device with several lenses reports motion in the pictures of all of them.
        let OnvifCamera { own_sources, other_sources, .. } = &*self.camera;
        let is_in = |sources: &std::collections::BTreeSet<String>| {
            message.sources.iter().any(|source| sources.contains(source))
        };
        if is_in(other_sources) && !is_in(own_sources) {
            return;
        }
        if let Some(detector) = self.tracker.note(&message, Instant::now()) {
            tracing::warn!(
                camera = %self.camera.session.address(),
                "the motion alarm `{}` has not ended for ten minutes, and is ignored until it does",
                crate::error::excerpt(&detector)
            );
        }
    }

    /// Returns the subscription. Makes a new one if there is none, or if it is old.
    async fn subscribed(&mut self) -> Result<Subscription, LinkError> {
        if let Some(known) = &self.subscription {
            if known.since.elapsed() < SUBSCRIPTION_AGE_MAX {
                return Ok(known.clone());
            }
            unsubscribe(&self.camera, known).await;
        }
        let fresh = self.subscribe().await?;
        self.subscription = Some(fresh.clone());
        // Asks for the present state. A detector that does not answer reports its next change.
        self.synchronize(&fresh).await;
        Ok(fresh)
    }

    async fn subscribe(&self) -> Result<Subscription, LinkError> {
        let Some(at) = &self.camera.events else {
            let problem = "hear of motion: the camera has no events (no Events service)";
            return Err(LinkError::Unsupported(problem.to_owned()));
        };
        let name = "CreatePullPointSubscription";
        let action = format!("{EVENTS}/EventPortType/{name}Request");
        let operation = Operation { namespace: EVENTS, name, action: &action };
        let named = at.url();
        let timed =
            format!("<o:InitialTerminationTime>{SUBSCRIPTION_TEXT}</o:InitialTerminationTime>");
        let subscribe = |content| {
            let addressing = Some(Addressing { to: &named, parameters: &[] });
            Call { at, operation, content, addressing, time_max: CALL_TIME_MAX }
        };
        let session = &self.camera.session;
        let answer = match session.call(&subscribe(&timed)).await {
            // Some cameras refuse any time that they have not chosen.
            Err(LinkError::Fault { .. }) => session.call(&subscribe("")).await?,
            answered => answered?,
        };
        let reference = answer.child("SubscriptionReference");
        let named = reference.and_then(|reference| reference.text_at(&["Address"]));
        let at = named.and_then(|named| session.resolve(named));
        let (Some(named), Some(at)) = (named, at) else {
            let problem = "it names no address of the subscription".to_owned();
            return Err(LinkError::Unreadable { call: name.to_owned(), problem });
        };
        let parameters = reference.and_then(|reference| reference.child("ReferenceParameters"));
        let parameters = parameters.map(|all| all.children.clone()).unwrap_or_default();
        Ok(Subscription { named: named.to_owned(), at, parameters, since: Instant::now() })
    }

    /// Asks the camera for the present state of all its detectors. A camera that does not have this
    /// operation reports the next change.
    async fn synchronize(&self, subscription: &Subscription) {
        let name = "SetSynchronizationPoint";
        let action = format!("{PORT_TYPE}/{name}Request");
        let operation = Operation { namespace: EVENTS, name, action: &action };
        let call = subscription.call(operation, "", CALL_TIME_MAX);
        if let Err(error) = self.camera.session.call(&call).await {
            tracing::debug!(camera = %self.camera.session.address(), "failed to {error}");
        }
    }
}

impl Drop for MotionEvents {
    fn drop(&mut self) {
        self.abandon();
    }
}

async fn unsubscribe(camera: &OnvifCamera, subscription: &Subscription) {
    let action = format!("{NOTIFICATION_ACTIONS}/SubscriptionManager/UnsubscribeRequest");
    let operation = Operation { namespace: NOTIFICATION, name: "Unsubscribe", action: &action };
    let call = subscription.call(operation, "", CALL_TIME_MAX);
    if let Err(error) = camera.session.call(&call).await {
        tracing::debug!(camera = %camera.session.address(), "failed to {error}");
    }
}

impl Subscription {
    fn call<'c>(
        &'c self,
        operation: Operation<'c>,
        content: &'c str,
        time_max: Duration,
    ) -> Call<'c> {
        let addressing = Some(Addressing { to: &self.named, parameters: &self.parameters });
        Call { at: &self.at, operation, content, addressing, time_max }
    }
}
