"""A robot with Nav2 on real DDS: what its nodes say and do is written here, how it is said is
Cyclone DDS's.

    python3 -m pip install cyclonedds==11.0.1
    python3 tests/peers/ros/dds/robot.py DOMAIN [NAMESPACE [DISTRIBUTION]]

It reads commands from standard input, one a line, and writes what happens to standard output:

| command | meaning |
|---|---|
| `behave arrive`, `behave wait`, `behave reject`, `behave abort CODE TEXT` | what becomes of goals |
| `lifecycle STATE` | the state that `bt_navigator` tells; goals are rejected unless it is `active` |
| `pose X Y`, `battery SHARE`, `docked true`, `docked false` | what the topics tell |
| `other X Y` | another program, with a participant of its own, sends a goal |

With `ROBOT_POSE="X Y"` in its environment, it tells this pose once, when it starts.

It says `ready`, `pose X Y`, `goal X Y`, `rejected`, `canceled`, `preempted`, `arrived`, `aborted`, `docked`,
`undocked` and `initialpose X Y`. It ends with its
standard input.
"""

import os
import queue
import sys
import threading
import uuid

import messages as ros
from cyclonedds.core import (
    InstanceState,
    Policy,
    Qos,
    ReadCondition,
    SampleState,
    ViewState,
    WaitSet,
)
from cyclonedds.domain import DomainParticipant
from cyclonedds.internal import InvalidSample
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

# The robot's clock: it says feedback and moves at this rate.
TICK_SECONDS = 0.02
TICKS_TO_ARRIVE = 10

ACCEPTED, EXECUTING, CANCELING, SUCCEEDED, CANCELED, ABORTED = 1, 2, 3, 4, 5, 6

CDR_1 = Policy.DataRepresentation(use_cdrv0_representation=True)
FOREVER = duration(infinite=True)


def quality(reliable: bool, latched: bool, depth: int) -> Qos:
    """Returns the quality of service as `rmw_cyclonedds_cpp` sets it."""
    kind = Policy.Reliability
    durability = Policy.Durability
    return Qos(
        kind.Reliable(FOREVER) if reliable else kind.BestEffort,
        durability.TransientLocal if latched else durability.Volatile,
        Policy.History.KeepLast(depth),
        CDR_1,
    )


SERVICE = quality(reliable=True, latched=False, depth=10)
SENSOR = quality(reliable=False, latched=False, depth=5)
LATCHED = quality(reliable=True, latched=True, depth=1)


def tell(*words) -> None:
    print(*words, flush=True)


class Node:
    """A participant with one node, which tells its entities on `ros_discovery_info`, as the nodes
    of ROS do. Bridges find topics and services of nodes by this."""

    def __init__(self, domain: int, namespace: str, name: str, types: ros.DiscoveryTypes):
        self.participant, self.types = DomainParticipant(domain), types
        self.prefix = f"/{namespace}" if namespace else ""
        self.info = types.node(self.prefix or "/", name)
        topic = Topic(self.participant, "ros_discovery_info", types.participant)
        self.discovery = DataWriter(self.participant, topic, qos=LATCHED)
        # The writers and readers end with their references.
        self.readers, self.writers = [], []

    def _topic(self, name: str, message: type) -> Topic:
        return Topic(self.participant, name, message)

    def writer(self, prefix: str, name: str, message: type, qos: Qos) -> DataWriter:
        topic = self._topic(f"{prefix}{self.prefix}/{name}", message)
        writer = DataWriter(self.participant, topic, qos=qos)
        self.writers.append(writer)
        self.info.writer_gid_seq.append(self.types.gid_of(writer))
        return writer

    def reader(self, prefix: str, name: str, message: type, qos: Qos) -> DataReader:
        topic = self._topic(f"{prefix}{self.prefix}/{name}", message)
        reader = DataReader(self.participant, topic, qos=qos)
        self.readers.append(reader)
        self.info.reader_gid_seq.append(self.types.gid_of(reader))
        return reader

    def announce(self) -> None:
        gid = self.types.gid_of(self.participant)
        self.discovery.write(self.types.participant(gid, [self.info]))


class Service:
    """A service: each request is answered by `answer(request)`, or later by `reply`."""

    def __init__(self, node: Node, name: str, request: type, response: type, answer):
        self.requests = node.reader("rq", f"{name}Request", request, SERVICE)
        self.replies = node.writer("rr", f"{name}Reply", response, SERVICE)
        self.answer = answer

    def spin(self) -> None:
        for request in self.requests.take(N=10):
            # A client that is gone leaves a sample without a request.
            if isinstance(request, InvalidSample):
                continue
            response = self.answer(request)
            if response is not None:
                self.reply(request, response)

    def reply(self, request, response) -> None:
        response.client, response.number = request.client, request.number
        self.replies.write(response)


class Goal:
    def __init__(self, uid, request):
        self.uid, self.request = uid, request
        self.status, self.result, self.ticks = EXECUTING, None, 0
        self.asked = []


class ActionServer:
    """An action server that does one goal at a time, as those of Nav2: a new goal takes the place
    of the one that is being carried out."""

    def __init__(self, node: Node, name: str, types: ros.ActionTypes, accepts, carry_out):
        self.types, self.accepts, self.carry_out = types, accepts, carry_out
        self.goals = {}
        part = f"{name}/_action"
        self.send = Service(
            node, f"{part}/send_goal", types.send_request, types.send_response, self._on_goal
        )
        self.cancel = Service(
            node,
            f"{part}/cancel_goal",
            ros.CancelGoalRequest,
            ros.CancelGoalResponse,
            self._on_cancel,
        )
        self.results = Service(
            node, f"{part}/get_result", types.result_request, types.result_response, self._on_ask
        )
        self.feedback = node.writer("rt", f"{part}/feedback", types.feedback_message, SERVICE)
        self.status = node.writer("rt", f"{part}/status", ros.GoalStatusArray, LATCHED)

    def spin(self) -> None:
        for service in (self.send, self.cancel, self.results):
            service.spin()

    def tick(self) -> None:
        for goal in list(self.goals.values()):
            if goal.status in (EXECUTING, CANCELING):
                goal.ticks += 1
                self.carry_out(self, goal)

    def say(self, goal: Goal, feedback) -> None:
        self.feedback.write(self.types.feedback_message(ros.Uuid(goal.uid), feedback))

    def end(self, goal: Goal, status: int, result=None) -> None:
        goal.status, goal.result = status, result or self.types.result()
        self._tell_status()
        for request in goal.asked:
            self.results.reply(request, self._ended(goal))

    def _ended(self, goal: Goal):
        return self.types.result_response(0, 0, goal.status, goal.result)

    def _on_goal(self, request):
        if not self.accepts(request.goal):
            return self.types.send_response()
        before = [one for one in self.goals.values() if one.status in (EXECUTING, CANCELING)]
        uid = list(request.goal_id.uuid)
        self.goals[bytes(uid)] = Goal(uid, request.goal)
        self._tell_status()
        # Nav2 accepts a goal before it gives up the one in whose place it comes.
        for goal in before:
            tell("preempted")
            self.end(goal, ABORTED)
        return self.types.send_response(accepted=True)

    def _on_cancel(self, request):
        zero = bytes(16)
        wanted = bytes(request.goal_info.goal_id.uuid)
        response = ros.CancelGoalResponse(return_code=1)
        if wanted != zero and wanted not in self.goals:
            response.return_code = 2
        for uid, goal in self.goals.items():
            if wanted in (zero, uid) and goal.status == EXECUTING:
                goal.status = CANCELING
                response.return_code = 0
                response.goals_canceling.append(ros.GoalInfo(ros.Uuid(goal.uid)))
            elif wanted == uid and goal.status not in (EXECUTING, CANCELING):
                response.return_code = 3
        self._tell_status()
        return response

    def _on_ask(self, request):
        goal = self.goals.get(bytes(request.goal_id.uuid))
        if goal is None:
            return self.types.result_response()
        if goal.result is not None:
            return self._ended(goal)
        goal.asked.append(request)
        return None

    def _tell_status(self) -> None:
        statuses = [
            ros.GoalStatus(ros.GoalInfo(ros.Uuid(goal.uid)), goal.status)
            for goal in self.goals.values()
        ]
        self.status.write(ros.GoalStatusArray(statuses))


class Robot:
    def __init__(self, domain: int, namespace: str, distribution: str):
        self.domain, self.namespace = domain, namespace
        self.types = ros.navigate_to_pose(distribution)
        self.discovery = ros.DiscoveryTypes(distribution)
        self.x, self.y, self.docked, self.state = 0.0, 0.0, False, "active"
        self.behavior, self.others = ["arrive"], []
        node = self.node = Node(domain, namespace, "bt_navigator", self.discovery)
        self.navigate = ActionServer(
            node, "navigate_to_pose", self.types, self._accepts, self._drive
        )
        self.dock = ActionServer(
            node, "dock", ros.DOCK, lambda goal: True, self._docks(ros.DOCK, True)
        )
        self.undock = ActionServer(
            node, "undock", ros.UNDOCK, lambda goal: True, self._docks(ros.UNDOCK, False)
        )
        self.get_state = Service(
            node,
            "bt_navigator/get_state",
            ros.GetStateRequest,
            ros.GetStateResponse,
            self._tell_lifecycle,
        )
        self.pose = node.writer("rt", "amcl_pose", ros.PoseWithCovarianceStamped, LATCHED)
        self.battery = node.writer("rt", "battery_state", ros.BatteryState, SENSOR)
        self.dock_status = node.writer("rt", "dock_status", ros.DockStatus, SENSOR)
        self.initial = node.reader("rt", "initialpose", ros.PoseWithCovarianceStamped, SERVICE)
        self.share = 0.75
        node.announce()
        if "ROBOT_POSE" in os.environ:
            self.obey(["pose", *os.environ["ROBOT_POSE"].split()])

    def _tell_lifecycle(self, _request):
        number = {"unconfigured": 1, "inactive": 2, "active": 3}[self.state]
        return ros.GetStateResponse(0, 0, ros.LifecycleState(number, self.state))

    def _accepts(self, goal) -> bool:
        if self.state != "active" or self.behavior[0] == "reject":
            tell("rejected")
            return False
        at = goal.pose.pose.position
        tell("goal", at.x, at.y)
        return True

    def _drive(self, server: ActionServer, goal: Goal) -> None:
        at = goal.request.pose.pose.position
        if goal.status == CANCELING:
            tell("canceled")
            return server.end(goal, CANCELED)
        if self.behavior[0] == "abort":
            tell("aborted")
            result = self.types.result()
            if hasattr(result, "error_code"):
                result.error_code = int(self.behavior[1])
            if hasattr(result, "error_msg"):
                result.error_msg = " ".join(self.behavior[2:])
            return server.end(goal, ABORTED, result)
        feedback = self.types.feedback()
        left = max(TICKS_TO_ARRIVE - goal.ticks, 0) / TICKS_TO_ARRIVE
        feedback.distance_remaining = left * ((at.x - self.x) ** 2 + (at.y - self.y) ** 2) ** 0.5
        server.say(goal, feedback)
        if self.behavior[0] == "arrive" and goal.ticks >= TICKS_TO_ARRIVE:
            self.x, self.y = at.x, at.y
            self.tell_pose()
            tell("arrived")
            server.end(goal, SUCCEEDED)

    def _docks(self, types: ros.ActionTypes, docks: bool):
        def carry_out(server: ActionServer, goal: Goal) -> None:
            if goal.ticks >= TICKS_TO_ARRIVE:
                self.docked = docks
                tell("docked" if docks else "undocked")
                server.end(goal, SUCCEEDED, types.result(is_docked=docks))

        return carry_out

    def tell_pose(self) -> None:
        message = ros.PoseWithCovarianceStamped()
        message.pose.pose.position = ros.Point(self.x, self.y)
        message.pose.covariance[0] = message.pose.covariance[7] = 0.05
        self.pose.write(message)
        tell("pose", self.x, self.y)

    def obey(self, words: list) -> None:
        match words:
            case ["behave", *behavior]:
                self.behavior = behavior
            case ["lifecycle", state]:
                self.state = state
            case ["pose", x, y]:
                self.x, self.y = float(x), float(y)
                self.tell_pose()
            case ["battery", share]:
                self.share = float(share)
            case ["docked", docked]:
                self.docked = docked == "true"
            case ["other", x, y]:
                self._send_other_goal(float(x), float(y))

    def _send_other_goal(self, x: float, y: float) -> None:
        other = Node(self.domain, self.namespace, "another_program", self.discovery)
        name = "navigate_to_pose/_action/send_goalRequest"
        writer = other.writer("rq", name, self.types.send_request, SERVICE)
        other.announce()
        request = self.types.send_request(client=7, number=1)
        request.goal_id = ros.Uuid(list(uuid.uuid4().bytes))
        request.goal.pose.pose.position = ros.Point(x, y)
        # Both are in one process: the match is immediate, and the writer keeps the request.
        writer.write(request)
        self.others.append(other)

    def run(self, commands: queue.Queue) -> None:
        waits = WaitSet(self.node.participant)
        # The conditions live as long as the wait set.
        new = SampleState.NotRead | ViewState.Any | InstanceState.Any
        conditions = [ReadCondition(reader, new) for reader in self.node.readers]
        for condition in conditions:
            waits.attach(condition)
        ticks = 0
        tell("ready")
        while True:
            waits.wait(duration(seconds=TICK_SECONDS))
            for server in (self.navigate, self.dock, self.undock):
                server.spin()
            self.get_state.spin()
            for message in self.initial.take(N=10):
                if isinstance(message, InvalidSample):
                    continue
                at = message.pose.pose.position
                tell("initialpose", at.x, at.y)
                self.x, self.y = at.x, at.y
                self.tell_pose()
            while not commands.empty():
                words = commands.get()
                if words is None:
                    return
                self.obey(words)
            for server in (self.navigate, self.dock, self.undock):
                server.tick()
            ticks += 1
            if ticks % 10 == 0:
                self.battery.write(ros.BatteryState(percentage=self.share))
                self.dock_status.write(ros.DockStatus(is_docked=self.docked))


def main() -> None:
    domain, namespace, distribution = (sys.argv[1:] + ["", "", ""])[:3]
    commands = queue.Queue()

    def read() -> None:
        for line in sys.stdin:
            commands.put(line.split())
        commands.put(None)

    threading.Thread(target=read, daemon=True).start()
    Robot(int(domain), namespace, distribution or "jazzy").run(commands)


if __name__ == "__main__":
    main()
