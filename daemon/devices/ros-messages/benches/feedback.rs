//! Times the decoding of the feedback of `NavigateToPose`, which a robot sends ten times a second.
//! Aim: less than 20 µs. `cargo bench -p ros-messages`.

use std::hint::black_box;
use std::time::Instant;

use ros_messages::Interfaces;
use serde_json::json;

/// Number of messages in a round; one round takes some ten milliseconds.
const MESSAGES: u32 = 10_000;

/// Number of rounds; their median is printed.
const ROUNDS: usize = 21;

fn main() {
    let interfaces = Interfaces::standard();
    let name = "nav2_msgs/action/NavigateToPose_FeedbackMessage";
    let value = json!({ "feedback": {
        "current_pose": {
            "header": { "frame_id": "map", "stamp": { "sec": 1_700_000_000, "nanosec": 5 } },
            "pose": { "position": { "x": 1.5, "y": -2.25 }, "orientation": { "z": 0.6, "w": 0.8 } },
        },
        "navigation_time": { "sec": 12 },
        "estimated_time_remaining": { "sec": 30 },
        "number_of_recoveries": 1,
        "distance_remaining": 7.5,
    }});
    let bytes = interfaces.encode(name, &value).expect("the value fits");
    let mut micros: Vec<f64> = (0..ROUNDS)
        .map(|_| {
            let begin = Instant::now();
            for _ in 0..MESSAGES {
                let decoded = interfaces.decode(name, black_box(&bytes)).expect("it is valid");
                black_box(decoded);
            }
            begin.elapsed().as_secs_f64() * 1e6 / f64::from(MESSAGES)
        })
        .collect();
    micros.sort_by(f64::total_cmp);
    println!(
        "decode {name}, {} bytes: median {:.2} µs, fastest {:.2} µs, slowest {:.2} µs",
        bytes.len(),
        micros[ROUNDS / 2],
        micros[0],
        micros[ROUNDS - 1],
    );
}
