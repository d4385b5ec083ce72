//! Goals of ROS 2 action servers.
//!
//! - The subscriptions to feedback and status come before the goal, because a bridge connects them
//!   only then.
//! - A goal ends with the answer to `get_result`, which the server sends when the goal is over. A
//!   request for the result that is lost with the link is repeated; the status topic reports the
//!   end as well.
//! - Messages about other goals are ignored: another program may use the same server.

use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use serde_json::{Value, json};
use tokio::time::Instant;

use crate::error::RosError;
use crate::link::RosLink;
use crate::topic::TopicReader;

/// How long an action server is awaited that does not answer. After the start of a bridge or of a
/// node, it takes a second or two until they know of each other.
const SERVER_AWAITED: Duration = Duration::from_secs(5);

/// How long an action server may take to accept or reject a goal. Nav2 answers within milliseconds;
/// a server that is activated just now takes a second or two.
const ACCEPT_TIMEOUT: Duration = Duration::from_secs(5);

/// How long an action server may take to answer a request to cancel a goal.
const CANCEL_TIMEOUT: Duration = Duration::from_secs(3);

/// How long one request for the result waits for its answer. The answer comes when the goal is
/// over. A bridge goes on to hold the request for a server that is gone, so the end of a server is
/// noticed only after this time.
const RESULT_TIMEOUT: Duration = Duration::from_secs(10);

/// How long the result is awaited after the status topic has reported the end of the goal.
const RESULT_AFTER_END: Duration = Duration::from_secs(2);

/// How long an action server may be unreachable while it has a goal. A robot changes its access
/// point within some seconds.
const SERVER_LOST_AFTER: Duration = Duration::from_secs(10);

/// Least duration of a request for the result that shows, although it ends without an answer, that
/// the robot is reachable: a node of the robot has held the request. If no node receives it, Zenoh
/// ends the request within the round trip.
pub(crate) const HELD_FOR: Duration = Duration::from_secs(1);

/// Pause before the next request for the result, after one that ended without an answer.
const ASK_AGAIN: Duration = Duration::from_millis(250);

/// State of a goal, from the numbers of `action_msgs/msg/GoalStatus`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RosGoalStatus {
    /// The goal was reached.
    Succeeded,
    /// The goal was cancelled on request.
    Canceled,
    /// The server gave the goal up, or took another one in its place.
    Aborted,
    /// The goal is not over, or its number is unknown.
    Active,
}

impl RosGoalStatus {
    fn of(number: i64) -> RosGoalStatus {
        match number {
            4 => RosGoalStatus::Succeeded,
            5 => RosGoalStatus::Canceled,
            6 => RosGoalStatus::Aborted,
            _ => RosGoalStatus::Active,
        }
    }
}

/// End of a goal.
#[derive(Clone, Debug, PartialEq)]
pub struct GoalEnd {
    /// How the goal ended.
    pub status: RosGoalStatus,
    /// Result of the server; empty if the server has none, and null if it was lost.
    pub result: Value,
    /// Whether the server took another program's goal in place of this one.
    pub is_replaced: bool,
}

/// A client of one action server.
#[derive(Clone)]
pub struct ActionClient {
    link: RosLink,
    name: String,
    type_name: String,
    feedback: TopicReader,
    status: TopicReader,
}

/// A goal that an action server has accepted. Dropping it before its end cancels it.
pub struct RosGoal {
    client: ActionClient,
    id: Vec<u8>,
    is_over: bool,
    /// Time of the last sign that the server is reachable.
    heard_at: Mutex<Instant>,
}

impl ActionClient {
    /// Creates a client of the server `name` of an action type such as
    /// `nav2_msgs/action/NavigateToPose`.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no link within the time `within`, or the type is not known.
    pub async fn new(
        link: &RosLink,
        name: &str,
        type_name: &str,
        within: Duration,
    ) -> Result<ActionClient, RosError> {
        let topic = |part: &str| format!("{name}/_action/{part}");
        let feedback_type = format!("{type_name}_FeedbackMessage");
        let feedback = link.subscribe(&topic("feedback"), &feedback_type, within).await?;
        let status_type = "action_msgs/msg/GoalStatusArray";
        let status = link.subscribe(&topic("status"), status_type, within).await?;
        let (name, type_name) = (name.to_owned(), type_name.to_owned());
        Ok(ActionClient { link: link.clone(), name, type_name, feedback, status })
    }

    /// Sends a goal, and returns it when the server has accepted it. A server that is not there yet
    /// is awaited for some seconds.
    ///
    /// # Errors
    ///
    /// Returns [`RosError::Rejected`] if the server rejects the goal, and another error if it does
    /// not answer in time.
    pub async fn send(&self, goal: &Value) -> Result<RosGoal, RosError> {
        let mut id = vec![0; 16];
        fastrand::Rng::new().fill(&mut id);
        let request = json!({ "goal_id": { "uuid": id }, "goal": goal });
        // The server may accept the goal although the answer is lost or comes too late, so the goal
        // is cancelled unless its rejection is known.
        let heard_at = Mutex::new(Instant::now());
        let mut sent = RosGoal { client: self.clone(), id, is_over: false, heard_at };
        let (response, is_first) = self.ask_to_accept(&request).await;
        let is_unsent =
            matches!(&response, Err(RosError::NotLinked { .. } | RosError::Encode { .. }));
        sent.is_over = is_unsent;
        if response?["accepted"].as_bool() == Some(true) {
            return Ok(sent);
        }
        // A server that has a goal rejects it when it comes again.
        sent.is_over = is_first;
        Err(RosError::Rejected { action: self.link.full_name(&self.name) })
    }

    /// Returns the name of the action, without the robot's namespace.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Returns a reader of the states of the server's goals.
    pub(crate) fn statuses(&self) -> TopicReader {
        self.status.clone()
    }

    /// Asks the server to accept a goal until there is a server that answers, for as long as
    /// servers are awaited. Returns the answer, and whether it answers the first request.
    async fn ask_to_accept(&self, request: &Value) -> (Result<Value, RosError>, bool) {
        let (began, mut is_first) = (Instant::now(), true);
        loop {
            let asked_at = Instant::now();
            let answer = self.call("send_goal", "SendGoal", request, ACCEPT_TIMEOUT).await;
            let is_nobody_there =
                matches!(&answer, Err(RosError::NoAnswer { .. })) && asked_at.elapsed() < HELD_FOR;
            if !is_nobody_there || began.elapsed() >= SERVER_AWAITED {
                return (answer, is_first);
            }
            is_first = false;
            tokio::time::sleep(ASK_AGAIN).await;
        }
    }

    async fn call(
        &self,
        part: &str,
        type_part: &str,
        request: &Value,
        within: Duration,
    ) -> Result<Value, RosError> {
        let service = format!("{}/_action/{part}", self.name);
        let type_name = format!("{}_{type_part}", self.type_name);
        self.link.call(&service, &type_name, request, within).await
    }

    /// Cancels a goal, or all goals if `id` is zero. Returns the identifiers of the goals that the
    /// server is cancelling.
    pub(crate) async fn cancel(&self, id: &[u8]) -> Result<Vec<Value>, RosError> {
        let service = format!("{}/_action/cancel_goal", self.name);
        let request = json!({ "goal_info": { "goal_id": { "uuid": id } } });
        let cancelled = self
            .link
            .call(&service, "action_msgs/srv/CancelGoal", &request, CANCEL_TIMEOUT)
            .await?;
        match cancelled["return_code"].as_i64() {
            // 0: cancelling; 3: the goal is over already.
            Some(0 | 3) => {
                let goals = cancelled["goals_canceling"].as_array();
                Ok(goals
                    .into_iter()
                    .flatten()
                    .map(|goal| goal["goal_id"]["uuid"].clone())
                    .collect())
            }
            code => {
                let code = code.map_or("none".to_owned(), |code| code.to_string());
                Err(RosError::Robot(format!("cancel its goal: the server answered {code}")))
            }
        }
    }
}

// === impl RosGoal ===

impl RosGoal {
    /// Waits for the end of the goal. `on_feedback` is called with each feedback that is read.
    ///
    /// # Errors
    ///
    /// Returns an error if the action server is lost.
    pub async fn end(
        &mut self,
        mut on_feedback: impl FnMut(&Value) + Send,
    ) -> Result<GoalEnd, RosError> {
        let mut feedback = self.client.feedback.clone();
        let follow = async {
            loop {
                match feedback.next().await {
                    Ok(message) if self.is_of_this(&message["goal_id"]) => {
                        self.hear();
                        on_feedback(&message["feedback"]);
                    }
                    Ok(_) => (),
                    Err(error @ RosError::Zenoh(_)) => return error,
                    // One message that cannot be read says nothing about the goal.
                    Err(error) => tracing::debug!(%error, "a feedback is ignored"),
                }
            }
        };
        let end = tokio::select! {
            end = self.result() => end,
            error = follow => Err(error),
        };
        self.is_over = end.is_ok();
        end
    }

    async fn result(&self) -> Result<GoalEnd, RosError> {
        let mut status = self.client.status.clone();
        let told_end = async {
            loop {
                match status.next().await {
                    Ok(statuses) => {
                        if let Some(ended) = self.ended(&statuses) {
                            return Ok(ended);
                        }
                    }
                    Err(error @ RosError::Zenoh(_)) => return Err(error),
                    // One message that cannot be read says nothing about the goal.
                    Err(error) => tracing::debug!(%error, "a status is ignored"),
                }
            }
        };
        let mut told_end = std::pin::pin!(told_end);
        let ended = tokio::select! {
            answer = self.ask_result() => return answer.map(|answer| self.end_of(&answer)),
            ended = &mut told_end => ended?,
        };
        // The answer comes at once, unless it was lost with the link.
        let answer = tokio::time::timeout(RESULT_AFTER_END, self.ask_result()).await;
        let result = match answer {
            Ok(Ok(answer)) => answer["result"].clone(),
            Ok(Err(_)) | Err(_) => Value::Null,
        };
        Ok(GoalEnd { status: ended, result, is_replaced: self.is_replaced() })
    }

    /// Requests the result until there is an answer, or the server counts as lost.
    async fn ask_result(&self) -> Result<Value, RosError> {
        let request = json!({ "goal_id": { "uuid": self.id } });
        self.hear();
        loop {
            let asked_at = Instant::now();
            let answer =
                self.client.call("get_result", "GetResult", &request, RESULT_TIMEOUT).await;
            match answer {
                Ok(answer) => return Ok(answer),
                // A node of the robot has held the request for a while, so the server is there. A
                // bridge may give up before the time limit of the request.
                Err(RosError::NoAnswer { .. }) if asked_at.elapsed() >= HELD_FOR => {
                    self.hear();
                }
                Err(error) if self.silence() >= SERVER_LOST_AFTER => {
                    return Err(RosError::Robot(format!(
                        "follow the goal: the robot is out of reach ({error})"
                    )));
                }
                Err(_) => tokio::time::sleep(ASK_AGAIN).await,
            }
        }
    }

    fn hear(&self) {
        *self.heard_at.lock().unwrap_or_else(PoisonError::into_inner) = Instant::now();
    }

    /// Returns the time since the last sign that the server is reachable.
    fn silence(&self) -> Duration {
        self.heard_at.lock().unwrap_or_else(PoisonError::into_inner).elapsed()
    }

    fn end_of(&self, answer: &Value) -> GoalEnd {
        let status = RosGoalStatus::of(answer["status"].as_i64().unwrap_or_default());
        // A server that does not know the goal any more answers with the status “unknown”.
        let status = if status == RosGoalStatus::Active { RosGoalStatus::Aborted } else { status };
        let is_replaced = status == RosGoalStatus::Aborted && self.is_replaced();
        GoalEnd { status, result: answer["result"].clone(), is_replaced }
    }

    /// Returns the final state of this goal in an array of statuses; `None` if the array does not
    /// report its end.
    fn ended(&self, statuses: &Value) -> Option<RosGoalStatus> {
        let own = list(statuses).find(|status| self.is_of_this(&status["goal_info"]["goal_id"]))?;
        let status = RosGoalStatus::of(own["status"].as_i64().unwrap_or_default());
        (status != RosGoalStatus::Active).then_some(status)
    }

    /// Whether the server carries out another goal at present, according to its last status.
    fn is_replaced(&self) -> bool {
        let Ok(Some(statuses)) = self.client.status.clone().latest() else { return false };
        list(&statuses).any(|status| {
            let is_running = matches!(status["status"].as_i64(), Some(1 | 2));
            is_running && !self.is_of_this(&status["goal_info"]["goal_id"])
        })
    }

    fn is_of_this(&self, goal_id: &Value) -> bool {
        let Some(bytes) = goal_id["uuid"].as_array() else { return false };
        bytes.len() == self.id.len()
            && bytes.iter().zip(&self.id).all(|(one, two)| one.as_u64() == Some(u64::from(*two)))
    }

    /// Cancels the goal, and waits until the server has confirmed that it is over.
    ///
    /// # Errors
    ///
    /// Returns an error if the server does not confirm the cancellation in time.
    pub async fn cancel(mut self) -> Result<GoalEnd, RosError> {
        self.client.cancel(&self.id).await?;
        let ended = tokio::time::timeout(CANCEL_TIMEOUT, self.end(|_| ())).await;
        ended.unwrap_or_else(|_| {
            Err(RosError::Robot(format!("cancel its goal: it went on for {CANCEL_TIMEOUT:?}")))
        })
    }
}

fn list(statuses: &Value) -> impl Iterator<Item = &Value> {
    statuses["status_list"].as_array().into_iter().flatten()
}

impl Drop for RosGoal {
    fn drop(&mut self) {
        let Ok(runtime) = tokio::runtime::Handle::try_current() else { return };
        if self.is_over {
            return;
        }
        let (client, id) = (self.client.clone(), std::mem::take(&mut self.id));
        runtime.spawn(async move {
            if let Err(error) = client.cancel(&id).await {
                tracing::warn!(action = client.name, %error, "a goal is perhaps not cancelled");
            }
        });
    }
}
