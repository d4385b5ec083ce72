//! A ROS 2 action server that carries out one goal at a time: a new goal takes the place of the
//! running one, as with Nav2.

use std::pin::Pin;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use serde_json::{Value, json};
use tokio::sync::watch;
use tokio::task::JoinHandle;
use tokio_util::task::AbortOnDropHandle;
use zenoh::query::Query;

use crate::wire::{RobotNode, Service};

/// Number of goals whose ends a server remembers.
const GOALS_MAX: usize = 64;

const EXECUTING: i8 = 2;
const SUCCEEDED: i8 = 4;
const CANCELED: i8 = 5;
const ABORTED: i8 = 6;

const STATUS: &str = "action_msgs/msg/GoalStatusArray";
const CANCEL: &str = "action_msgs/srv/CancelGoal";

/// Function that publishes feedback of the running goal.
pub type Feedback = Arc<dyn Fn(Value) + Send + Sync>;
type Running = Pin<Box<dyn Future<Output = Result<Value, Value>> + Send>>;

/// Function by which a server carries out a goal. Returns the result, or, as the error, the result
/// of an aborted goal.
pub type RunGoal = Arc<dyn Fn(Value, Feedback) -> Running + Send + Sync>;
/// Function that returns whether a server accepts goals at present.
pub type AcceptsGoals = Arc<dyn Fn() -> bool + Send + Sync>;

/// A ROS 2 action server.
pub struct ActionServer {
    node: Arc<RobotNode>,
    name: &'static str,
    type_name: &'static str,
    accepts: AcceptsGoals,
    run: RunGoal,
    answers_results: Arc<AtomicBool>,
    goals: watch::Sender<Vec<ServedGoal>>,
    running: Mutex<Option<JoinHandle<()>>>,
}

#[derive(Clone)]
struct ServedGoal {
    id: Value,
    status: i8,
    result: Value,
}

impl ActionServer {
    /// Starts a server, which serves goals until the returned task is dropped. Requests for results are answered while
    /// `answers_results` is true.
    ///
    /// # Errors
    ///
    /// Returns an error if Zenoh does not declare the services of the action.
    pub async fn serve(
        node: &Arc<RobotNode>,
        name: &'static str,
        type_name: &'static str,
        accepts: AcceptsGoals,
        run: RunGoal,
        answers_results: &Arc<AtomicBool>,
    ) -> zenoh::Result<AbortOnDropHandle<()>> {
        let server = Arc::new(ActionServer {
            node: Arc::clone(node),
            name,
            type_name,
            accepts,
            run,
            answers_results: Arc::clone(answers_results),
            goals: watch::Sender::new(Vec::new()),
            running: Mutex::new(None),
        });
        let mut send_goal = server.service("send_goal", "SendGoal").await?;
        let mut get_result = server.service("get_result", "GetResult").await?;
        let cancel = format!("{name}/_action/cancel_goal");
        let mut cancel_goal = node.service(&cancel, CANCEL).await?;
        Ok(AbortOnDropHandle::new(tokio::spawn(async move {
            loop {
                tokio::select! {
                    Some(query) = send_goal.next() => server.send_goal(&query).await,
                    Some(query) = get_result.next() => {
                        tokio::spawn(Arc::clone(&server).get_result(query));
                    }
                    Some(query) = cancel_goal.next() => server.cancel_goal(&query).await,
                    else => return,
                }
            }
        })))
    }

    async fn service(&self, part: &str, type_part: &str) -> zenoh::Result<Service> {
        let name = format!("{}/_action/{part}", self.name);
        self.node.service(&name, &format!("{}_{type_part}", self.type_name)).await
    }

    async fn send_goal(self: &Arc<Self>, query: &Query) {
        let type_name = format!("{}_SendGoal", self.type_name);
        let Some(request) = self.node.request(query, &type_name) else { return };
        let accepted = (self.accepts)();
        if accepted {
            self.begin(request["goal_id"]["uuid"].clone(), request["goal"].clone()).await;
        }
        let name = format!("{}/_action/send_goal", self.name);
        self.node.reply(query, &name, &type_name, &json!({ "accepted": accepted })).await;
    }

    async fn begin(self: &Arc<Self>, id: Value, goal: Value) {
        self.stop_running().await;
        self.goals.send_modify(|goals| {
            for goal in goals.iter_mut().filter(|goal| goal.status == EXECUTING) {
                goal.status = ABORTED;
            }
            goals.push(ServedGoal { id: id.clone(), status: EXECUTING, result: json!({}) });
            let surplus = goals.len().saturating_sub(GOALS_MAX);
            goals.drain(..surplus);
        });
        self.publish_status().await;
        let (server, own) = (Arc::clone(self), id);
        let task = tokio::spawn(async move {
            let (node, id) = (Arc::clone(&server.node), own.clone());
            let (topic, type_name) = (
                format!("{}/_action/feedback", server.name),
                format!("{}_FeedbackMessage", server.type_name),
            );
            let feedback: Feedback = Arc::new(move |feedback| {
                let message = json!({ "goal_id": { "uuid": id }, "feedback": feedback });
                let (node, topic, type_name) =
                    (Arc::clone(&node), topic.clone(), type_name.clone());
                tokio::spawn(async move { node.publish(&topic, &type_name, &message).await });
            });
            let (status, result) = match (server.run)(goal, feedback).await {
                Ok(result) => (SUCCEEDED, result),
                Err(result) => (ABORTED, result),
            };
            server.finish(&own, status, result).await;
        });
        *self.running.lock().unwrap_or_else(PoisonError::into_inner) = Some(task);
    }

    /// Aborts the task of the running goal, and waits until the task has ended.
    async fn stop_running(&self) {
        let running = self.running.lock().unwrap_or_else(PoisonError::into_inner).take();
        if let Some(running) = running {
            running.abort();
            drop(running.await);
        }
    }

    async fn finish(&self, id: &Value, status: i8, result: Value) {
        self.goals.send_modify(|goals| {
            let is_own = |goal: &&mut ServedGoal| goal.id == *id && goal.status == EXECUTING;
            if let Some(goal) = goals.iter_mut().find(is_own) {
                (goal.status, goal.result) = (status, result);
            }
        });
        self.publish_status().await;
    }

    async fn publish_status(&self) {
        let status = |goal: &ServedGoal| json!({ "goal_info": { "goal_id": { "uuid": goal.id } }, "status": goal.status });
        let statuses: Vec<Value> = self.goals.borrow().iter().map(status).collect();
        let topic = format!("{}/_action/status", self.name);
        self.node.publish(&topic, STATUS, &json!({ "status_list": statuses })).await;
    }

    async fn get_result(self: Arc<Self>, query: Query) {
        if !self.answers_results.load(Ordering::Relaxed) {
            return;
        }
        let type_name = format!("{}_GetResult", self.type_name);
        let Some(request) = self.node.request(&query, &type_name) else { return };
        let id = &request["goal_id"]["uuid"];
        let mut goals = self.goals.subscribe();
        let is_over = |goals: &Vec<ServedGoal>| {
            goals.iter().all(|goal| goal.id != *id || goal.status != EXECUTING)
        };
        let response = match goals.wait_for(is_over).await {
            Ok(goals) => match goals.iter().find(|goal| goal.id == *id) {
                Some(goal) => json!({ "status": goal.status, "result": goal.result }),
                None => json!({ "status": 0 }),
            },
            Err(_) => return,
        };
        let name = format!("{}/_action/get_result", self.name);
        self.node.reply(&query, &name, &type_name, &response).await;
    }

    async fn cancel_goal(&self, query: &Query) {
        let Some(request) = self.node.request(query, CANCEL) else { return };
        let id = &request["goal_info"]["goal_id"]["uuid"];
        // An identifier of zeros stands for all goals.
        let is_all =
            id.as_array().is_some_and(|bytes| bytes.iter().all(|byte| byte.as_u64() == Some(0)));
        let is_meant = |goal: &&ServedGoal| goal.status == EXECUTING && (is_all || goal.id == *id);
        let running = self.goals.borrow().iter().find(is_meant).map(|goal| goal.id.clone());
        let name = format!("{}/_action/cancel_goal", self.name);
        let code = if running.is_some() || is_all { 0 } else { 3 };
        if let Some(id) = running {
            self.stop_running().await;
            self.finish(&id, CANCELED, json!({})).await;
        }
        self.node.reply(query, &name, CANCEL, &json!({ "return_code": code })).await;
    }
}
