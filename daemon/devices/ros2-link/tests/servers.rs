//! Action servers that come late, or go.

mod support;

use std::sync::Mutex;

use ros_messages::Interfaces;
use ros2_link::{ActionClient, RosError, RosLink};
use serde_json::{Value, json};
use support::{PATIENCE, link, robot};
use tokio::sync::mpsc;
use zenoh::query::{Query, Queryable};
use zenoh::{Session, Wait};

const ACTION: &str = "nav2_msgs/action/NavigateToPose";

async fn client(link: &RosLink) -> ActionClient {
    let client = ActionClient::new(link, "navigate_to_pose", ACTION, PATIENCE).await;
    client.expect("it is linked")
}

/// Offers a service of the action. `answer` is called with each request.
async fn offer(
    robot: &Session,
    part: &str,
    answer: impl Fn(Query) + Send + Sync + 'static,
) -> Queryable<()> {
    let key = format!("navigate_to_pose/_action/{part}");
    robot.declare_queryable(key).callback(answer).await.expect("it is offered")
}

fn reply(query: &Query, type_name: &str, response: &Value) {
    let payload = Interfaces::standard().encode(type_name, response).expect("a response");
    query.reply(query.key_expr().clone(), payload).wait().expect("the caller is there");
}

fn accept(query: &Query, is_accepted: bool) {
    let accepted = json!({ "accepted": is_accepted });
    reply(query, &format!("{ACTION}_SendGoal_Response"), &accepted);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_server_that_comes_while_the_goal_is_sent_is_awaited() {
    let (robot, endpoint) = robot().await;
    let link = link(&endpoint);
    let client = client(&link).await;
    let sending = tokio::spawn(async move { client.send(&json!({})).await });
    let _server = offer(&robot, "send_goal", |query| accept(&query, true)).await;
    sending.await.expect("no panic").expect("it is accepted");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_server_that_never_comes_is_named() {
    let (_robot, endpoint) = robot().await;
    let link = link(&endpoint);
    let error = client(&link).await.send(&json!({})).await.err().expect("nobody is there");
    assert!(matches!(&error, RosError::NoAnswer { .. }), "{error}");
    assert!(error.to_string().contains("navigate_to_pose"), "{error}");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_goal_that_comes_again_and_is_rejected_is_cancelled() {
    let (robot, endpoint) = robot().await;
    let link = link(&endpoint);
    let client = client(&link).await;
    let (sender, mut cancelled) = mpsc::unbounded_channel();
    let _cancel = offer(&robot, "cancel_goal", move |_| {
        sender.send(()).ok();
    })
    .await;
    // The answer to the first question is lost; the server has the goal.
    let questions = Mutex::new(0);
    let _server = offer(&robot, "send_goal", move |query| {
        let mut questions = questions.lock().expect("no panic");
        *questions += 1;
        if *questions > 1 {
            accept(&query, false);
        }
    })
    .await;
    let error = client.send(&json!({})).await.err().expect("it is rejected");
    assert!(matches!(error, RosError::Rejected { .. }), "{error}");
    let cancelled = tokio::time::timeout(PATIENCE, cancelled.recv()).await;
    cancelled.expect("it is cancelled in time").expect("it is cancelled");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_server_that_is_gone_is_noticed_although_its_bridge_holds_the_question() {
    let (robot, endpoint) = robot().await;
    let link = link(&endpoint);
    let client = client(&link).await;
    let (held, mut questions) = mpsc::unbounded_channel();
    let results = offer(&robot, "get_result", move |query| drop(held.send(query))).await;
    let server = offer(&robot, "send_goal", |query| accept(&query, true)).await;
    let mut goal = client.send(&json!({})).await.expect("it is accepted");
    let following = tokio::spawn(async move { goal.end(|_| ()).await });
    let _question = questions.recv().await.expect("it is asked for the result");
    drop((server, results));
    let error = tokio::time::timeout(PATIENCE, following).await.expect("it is noticed in time");
    let error = error.expect("no panic").expect_err("the server is gone");
    assert!(error.to_string().contains("out of reach"), "{error}");
}
