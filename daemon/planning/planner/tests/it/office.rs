//! The office problem: the plan uses the sensor in the room instead of a robot that would have to
//! drive there.

use expect_test::expect;

use crate::support::check;

const DOMAIN: &str = include_str!("../../benches/office/domain.pddl");
const PROBLEM: &str = include_str!("../../benches/office/problem.pddl");

#[test]
fn present_sensors_report_and_robots_go_to_rooms_without_one() {
    check(
        DOMAIN,
        PROBLEM,
        expect![[r#"
            (measure-temperature ir-2 turtlebot-2 lab)
            (report-temperature thermo2 office2)
            (report-temperature thermo1 office1)
            (move turtlebot-1 hall kitchen)
            (move turtlebot-2 lab hall)
            (move turtlebot-2 hall office3)
            (measure-temperature ir-2 turtlebot-2 office3)
            (measure-temperature ir-1 turtlebot-1 kitchen)
            cost 26.5, optimal
        "#]],
    );
}

#[test]
fn the_robot_takes_over_when_a_sensor_leaves() {
    let problem = PROBLEM.replace("(located thermo2 office2)", "");
    check(
        DOMAIN,
        &problem,
        expect![[r#"
            (measure-temperature ir-2 turtlebot-2 lab)
            (report-temperature thermo1 office1)
            (move turtlebot-1 hall office2)
            (measure-temperature ir-1 turtlebot-1 office2)
            (move turtlebot-1 office2 hall)
            (move turtlebot-1 hall kitchen)
            (move turtlebot-2 lab hall)
            (move turtlebot-2 hall office3)
            (measure-temperature ir-2 turtlebot-2 office3)
            (measure-temperature ir-1 turtlebot-1 kitchen)
            cost 39.5, optimal
        "#]],
    );
}

#[test]
fn no_robot_can_enter_a_room_without_a_door() {
    let problem = PROBLEM.replace("(connected hall kitchen)", "");
    check(
        DOMAIN,
        &problem,
        expect![[r#"
        proven unsolvable before search
    "#]],
    );
}
