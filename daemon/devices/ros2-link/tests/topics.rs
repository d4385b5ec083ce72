//! Topics whose last message is kept by their publisher, as the localization of a robot does.

mod support;

use std::time::Duration;

use ros_messages::Interfaces;
use ros2_link::TopicReader;
use serde_json::{Value, json};
use support::{PATIENCE, link, robot};
use tokio::sync::mpsc;
use zenoh::liveliness::LivelinessToken;
use zenoh::query::Queryable;
use zenoh::time::Timestamp;
use zenoh::{Session, Wait};

const TOPIC: &str = "amcl_pose";
const TIME: &str = "builtin_interfaces/msg/Time";

/// Key under which `zenoh-ext` keeps the last message of a publisher, and says that it is there.
const PUBLISHER: &str = "amcl_pose/@adv/pub/1/uhlc/_";

async fn reader(endpoint: &str) -> TopicReader {
    link(endpoint).subscribe(TOPIC, TIME, PATIENCE).await.expect("it is linked")
}

fn message(sec: i32) -> Vec<u8> {
    let message = json!({ "sec": sec, "nanosec": 0 });
    Interfaces::standard().encode(TIME, &message).expect("a message")
}

/// A publisher that appears, and has published before.
struct Publisher {
    asked: mpsc::UnboundedReceiver<()>,
    _kept: Queryable<()>,
    _token: LivelinessToken,
}

async fn publisher(robot: &Session, sec: i32, at: Timestamp) -> Publisher {
    let (sender, asked) = mpsc::unbounded_channel();
    let kept = robot.declare_queryable(PUBLISHER).callback(move |query| {
        query.reply(TOPIC, message(sec)).timestamp(at).wait().expect("the caller is there");
        sender.send(()).ok();
    });
    let _kept = kept.await.expect("a queryable");
    let _token = robot.liveliness().declare_token(PUBLISHER).await.expect("a token");
    Publisher { asked, _kept, _token }
}

async fn next(reader: &mut TopicReader) -> Value {
    let next = tokio::time::timeout(PATIENCE, reader.next()).await;
    next.expect("there is one in time").expect("it is read")["sec"].clone()
}

#[tokio::test(flavor = "multi_thread")]
async fn a_publisher_that_appears_later_is_asked_for_its_last_message() {
    let (robot, endpoint) = robot().await;
    let mut reader = reader(&endpoint).await;
    assert_eq!(reader.latest().expect("nothing"), None);
    let first = publisher(&robot, 1, robot.new_timestamp()).await;
    assert_eq!(next(&mut reader).await, json!(1));
    // The node is started anew.
    drop(first);
    let _second = publisher(&robot, 2, robot.new_timestamp()).await;
    assert_eq!(next(&mut reader).await, json!(2));
}

/// A node that is started anew may be there before the end of the former one is noticed.
#[tokio::test(flavor = "multi_thread")]
async fn the_message_of_a_publisher_that_remains_is_kept_when_another_one_ends() {
    let (robot, endpoint) = robot().await;
    let mut reader = reader(&endpoint).await;
    let former = robot.liveliness().declare_token("amcl_pose/@adv/pub/2/uhlc/_").await;
    let _present = publisher(&robot, 2, robot.new_timestamp()).await;
    assert_eq!(next(&mut reader).await, json!(2));
    drop(former.expect("a token"));
    assert_eq!(next(&mut reader).await, json!(2), "it is asked again");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_message_that_was_kept_does_not_replace_a_newer_one() {
    let (robot, endpoint) = robot().await;
    let mut reader = reader(&endpoint).await;
    let earlier = robot.new_timestamp();
    let publish = async |sec| {
        let put = robot.put(TOPIC, message(sec)).timestamp(robot.new_timestamp());
        put.await.expect("it is published");
    };
    // The first messages may be published before the subscription is known.
    while tokio::time::timeout(Duration::from_millis(100), reader.next()).await.is_err() {
        publish(2).await;
    }
    let mut kept = publisher(&robot, 1, earlier).await;
    let asked = tokio::time::timeout(PATIENCE, kept.asked.recv()).await;
    asked.expect("it is asked in time").expect("it is asked");
    publish(3).await;
    loop {
        match next(&mut reader).await.as_i64() {
            Some(3) => break,
            // One of the first messages.
            sec => assert_eq!(sec, Some(2)),
        }
    }
}
