//! The built-in definitions, those of ROS 2 Jazzy. Each file names its source.

/// The package, the name of the file, and the text of a definition.
type StandardDefinition = (&'static str, &'static str, &'static str);

macro_rules! definition {
    ($package:literal, $kind:literal, $name:literal) => {
        (
            $package,
            concat!($name, ".", $kind),
            include_str!(concat!("../definitions/", $package, "/", $kind, "/", $name, ".", $kind)),
        )
    };
}

/// All built-in definitions.
pub(crate) const DEFINITIONS: &[StandardDefinition] = &[
    definition!("action_msgs", "msg", "GoalInfo"),
    definition!("action_msgs", "msg", "GoalStatus"),
    definition!("action_msgs", "msg", "GoalStatusArray"),
    definition!("action_msgs", "srv", "CancelGoal"),
    definition!("builtin_interfaces", "msg", "Duration"),
    definition!("builtin_interfaces", "msg", "Time"),
    definition!("geometry_msgs", "msg", "Point"),
    definition!("geometry_msgs", "msg", "Point32"),
    definition!("geometry_msgs", "msg", "Pose"),
    definition!("geometry_msgs", "msg", "PoseStamped"),
    definition!("geometry_msgs", "msg", "PoseWithCovariance"),
    definition!("geometry_msgs", "msg", "PoseWithCovarianceStamped"),
    definition!("geometry_msgs", "msg", "Quaternion"),
    definition!("geometry_msgs", "msg", "Twist"),
    definition!("geometry_msgs", "msg", "TwistStamped"),
    definition!("geometry_msgs", "msg", "TwistWithCovariance"),
    definition!("geometry_msgs", "msg", "Vector3"),
    definition!("irobot_create_msgs", "action", "Dock"),
    definition!("irobot_create_msgs", "action", "Undock"),
    definition!("irobot_create_msgs", "msg", "DockStatus"),
    definition!("lifecycle_msgs", "msg", "State"),
    definition!("lifecycle_msgs", "msg", "Transition"),
    definition!("lifecycle_msgs", "srv", "ChangeState"),
    definition!("lifecycle_msgs", "srv", "GetState"),
    definition!("nav2_msgs", "action", "NavigateToPose"),
    definition!("nav_msgs", "msg", "Odometry"),
    definition!("sensor_msgs", "msg", "BatteryState"),
    definition!("sensor_msgs", "msg", "Range"),
    definition!("sensor_msgs", "msg", "Temperature"),
    definition!("service_msgs", "msg", "ServiceEventInfo"),
    definition!("std_msgs", "msg", "Bool"),
    definition!("std_msgs", "msg", "Empty"),
    definition!("std_msgs", "msg", "Float64"),
    definition!("std_msgs", "msg", "Header"),
    definition!("std_msgs", "msg", "Int32"),
    definition!("std_msgs", "msg", "String"),
    definition!("std_msgs", "msg", "UInt8"),
    definition!("std_srvs", "srv", "Empty"),
    definition!("std_srvs", "srv", "SetBool"),
    definition!("std_srvs", "srv", "Trigger"),
    definition!("unique_identifier_msgs", "msg", "UUID"),
];
