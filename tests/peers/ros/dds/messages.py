"""The messages of a robot with Nav2, as ROS 2 puts them on DDS.

The names of types are mangled as ROS mangles them (`pkg::msg::dds_::Name_`). Requests and responses
of services begin with a header of 16 bytes, the client and the number of the call, which is how
`rmw_cyclonedds_cpp` (and with it the bridge of Zenoh) tells calls apart.
"""

from dataclasses import dataclass, field

from cyclonedds.idl import IdlStruct
from cyclonedds.idl._main import IdlMeta
from cyclonedds.idl.types import array, float32, float64, int8, int16, int32, int64, sequence, uint8, uint16, uint32, uint64


def ros(package: str, kind: str, name: str) -> str:
    """Returns the name on DDS of a type of ROS."""
    return f"{package}::{kind}::dds_::{name}_"


@dataclass
class Time(IdlStruct, typename=ros("builtin_interfaces", "msg", "Time")):
    sec: int32 = 0
    nanosec: uint32 = 0


@dataclass
class Duration(IdlStruct, typename=ros("builtin_interfaces", "msg", "Duration")):
    sec: int32 = 0
    nanosec: uint32 = 0


@dataclass
class Header(IdlStruct, typename=ros("std_msgs", "msg", "Header")):
    stamp: Time = field(default_factory=Time)
    frame_id: str = "map"


@dataclass
class Point(IdlStruct, typename=ros("geometry_msgs", "msg", "Point")):
    x: float64 = 0.0
    y: float64 = 0.0
    z: float64 = 0.0


@dataclass
class Quaternion(IdlStruct, typename=ros("geometry_msgs", "msg", "Quaternion")):
    x: float64 = 0.0
    y: float64 = 0.0
    z: float64 = 0.0
    w: float64 = 1.0


@dataclass
class Pose(IdlStruct, typename=ros("geometry_msgs", "msg", "Pose")):
    position: Point = field(default_factory=Point)
    orientation: Quaternion = field(default_factory=Quaternion)


@dataclass
class PoseStamped(IdlStruct, typename=ros("geometry_msgs", "msg", "PoseStamped")):
    header: Header = field(default_factory=Header)
    pose: Pose = field(default_factory=Pose)


@dataclass
class PoseWithCovariance(IdlStruct, typename=ros("geometry_msgs", "msg", "PoseWithCovariance")):
    pose: Pose = field(default_factory=Pose)
    covariance: array[float64, 36] = field(default_factory=lambda: [0.0] * 36)


@dataclass
class PoseWithCovarianceStamped(
    IdlStruct, typename=ros("geometry_msgs", "msg", "PoseWithCovarianceStamped")
):
    header: Header = field(default_factory=Header)
    pose: PoseWithCovariance = field(default_factory=PoseWithCovariance)


@dataclass
class BatteryState(IdlStruct, typename=ros("sensor_msgs", "msg", "BatteryState")):
    header: Header = field(default_factory=Header)
    voltage: float32 = 16.0
    temperature: float32 = 20.0
    current: float32 = -0.5
    charge: float32 = float("nan")
    capacity: float32 = 2.5
    design_capacity: float32 = 2.5
    percentage: float32 = 1.0
    power_supply_status: uint8 = 2
    power_supply_health: uint8 = 1
    power_supply_technology: uint8 = 2
    present: bool = True
    cell_voltage: sequence[float32] = field(default_factory=list)
    cell_temperature: sequence[float32] = field(default_factory=list)
    location: str = "base"
    serial_number: str = ""


@dataclass
class DockStatus(IdlStruct, typename=ros("irobot_create_msgs", "msg", "DockStatus")):
    header: Header = field(default_factory=Header)
    dock_visible: bool = True
    is_docked: bool = False


@dataclass
class Uuid(IdlStruct, typename=ros("unique_identifier_msgs", "msg", "UUID")):
    uuid: array[uint8, 16] = field(default_factory=lambda: [0] * 16)


@dataclass
class GoalInfo(IdlStruct, typename=ros("action_msgs", "msg", "GoalInfo")):
    goal_id: Uuid = field(default_factory=Uuid)
    stamp: Time = field(default_factory=Time)


@dataclass
class GoalStatus(IdlStruct, typename=ros("action_msgs", "msg", "GoalStatus")):
    goal_info: GoalInfo = field(default_factory=GoalInfo)
    status: int8 = 0


@dataclass
class GoalStatusArray(IdlStruct, typename=ros("action_msgs", "msg", "GoalStatusArray")):
    status_list: sequence[GoalStatus] = field(default_factory=list)


@dataclass
class CancelGoalRequest(IdlStruct, typename=ros("action_msgs", "srv", "CancelGoal_Request")):
    client: uint64 = 0
    number: int64 = 0
    goal_info: GoalInfo = field(default_factory=GoalInfo)


@dataclass
class CancelGoalResponse(IdlStruct, typename=ros("action_msgs", "srv", "CancelGoal_Response")):
    client: uint64 = 0
    number: int64 = 0
    return_code: int8 = 0
    goals_canceling: sequence[GoalInfo] = field(default_factory=list)


@dataclass
class LifecycleState(IdlStruct, typename=ros("lifecycle_msgs", "msg", "State")):
    id: uint8 = 3
    label: str = "active"


@dataclass
class GetStateRequest(IdlStruct, typename=ros("lifecycle_msgs", "srv", "GetState_Request")):
    client: uint64 = 0
    number: int64 = 0
    # ROS gives empty messages one byte.
    structure_needs_at_least_one_member: uint8 = 0


@dataclass
class GetStateResponse(IdlStruct, typename=ros("lifecycle_msgs", "srv", "GetState_Response")):
    client: uint64 = 0
    number: int64 = 0
    current_state: LifecycleState = field(default_factory=LifecycleState)


def struct(typename: str, fields: dict) -> type:
    """Returns a message whose fields are pairs of a type and a maker of its default."""
    namespace = IdlMeta.__prepare__(typename, (IdlStruct,), typename=typename)
    for key, (hint, make) in fields.items():
        namespace["__annotations__"][key] = hint
        namespace[key] = field(default_factory=make)
    return dataclass(IdlMeta(typename.split("::")[-1], (IdlStruct,), namespace))


class DiscoveryTypes:
    """The types of `ros_discovery_info`. Identifiers had 24 bytes until Humble, of which the last
    eight are zero, and have 16 since."""

    def __init__(self, distribution: str):
        self.size = size = 24 if distribution == "humble" else 16
        common = "rmw_dds_common"
        self.gid = struct(
            ros(common, "msg", "Gid"), {"data": (array[uint8, size], lambda: [0] * size)}
        )
        gids = (sequence[self.gid], list)
        self.node = struct(
            ros(common, "msg", "NodeEntitiesInfo"),
            {
                "node_namespace": (str, str),
                "node_name": (str, str),
                "reader_gid_seq": gids,
                "writer_gid_seq": gids,
            },
        )
        self.participant = struct(
            ros(common, "msg", "ParticipantEntitiesInfo"),
            {"gid": (self.gid, self.gid), "node_entities_info_seq": (sequence[self.node], list)},
        )

    def gid_of(self, entity):
        return self.gid(list(entity.guid.bytes.ljust(self.size, bytes(1))))


class ActionTypes:
    """The types that ROS generates from an action: of its topics, and of its services."""

    def __init__(self, package: str, name: str, goal: dict, result: dict, feedback: dict):
        def part(suffix: str, fields: dict) -> type:
            return struct(ros(package, "action", f"{name}_{suffix}"), fields)

        call = {"client": (uint64, int), "number": (int64, int)}
        empty = {"structure_needs_at_least_one_member": (uint8, int)}
        of_goal = {"goal_id": (Uuid, Uuid)}
        self.goal = part("Goal", goal or empty)
        self.result = part("Result", result or empty)
        self.feedback = part("Feedback", feedback or empty)
        self.send_request = part(
            "SendGoal_Request", {**call, **of_goal, "goal": (self.goal, self.goal)}
        )
        accepted = {"accepted": (bool, bool), "stamp": (Time, Time)}
        self.send_response = part("SendGoal_Response", {**call, **accepted})
        self.result_request = part("GetResult_Request", {**call, **of_goal})
        ended = {"status": (int8, int), "result": (self.result, self.result)}
        self.result_response = part("GetResult_Response", {**call, **ended})
        self.feedback_message = part(
            "FeedbackMessage", {**of_goal, "feedback": (self.feedback, self.feedback)}
        )


def navigate_to_pose(distribution: str) -> ActionTypes:
    """Returns the types of NavigateToPose of a distribution of ROS."""
    result = {
        "humble": {},
        "iron": {"error_code": (uint16, int)},
        "jazzy": {"error_code": (uint16, int), "error_msg": (str, str)},
    }[distribution]
    feedback = {
        "current_pose": (PoseStamped, PoseStamped),
        "navigation_time": (Duration, Duration),
        "estimated_time_remaining": (Duration, Duration),
        "number_of_recoveries": (int16, int),
        "distance_remaining": (float32, float),
    }
    goal = {"pose": (PoseStamped, PoseStamped), "behavior_tree": (str, str)}
    return ActionTypes("nav2_msgs", "NavigateToPose", goal, result, feedback)


DOCK = ActionTypes(
    "irobot_create_msgs", "Dock", {}, {"is_docked": (bool, bool)}, {"sees_dock": (bool, bool)}
)
UNDOCK = ActionTypes("irobot_create_msgs", "Undock", {}, {"is_docked": (bool, bool)}, {})
