"""A plugin in Python (pip install eclipse-zenoh). Its daemon plans and bids for it, and lets no command be done
twice. Only the measuring is left to this file. See docs/plugins.md and docs/protocol.md."""
import json, sys, threading, time
import zenoh

hello = json.loads(sys.stdin.readline())  # the agents to run, and the endpoint to join
ROOT, DAEMON, LIFE = f"althing/{hello['ecosystem']}", hello["daemon"], time.time_ns() // 1000
HOST = f"{ROOT}/in/{hello['host']['daemon']}/{hello['host']['agent']}"
agents = {agent["name"]: agent | {"sequence": 0, "known": ""} for agent in hello["agents"]}
done, count = {}, iter(range(1, sys.maxsize))
session = zenoh.open(zenoh.Config.from_json5(json.dumps({  # no shared memory, no scouting
    "mode": "client", "connect": {"endpoints": [hello["endpoint"]]}, "scouting": {"multicast": {"enabled": False}},
    "transport": {"shared_memory": {"enabled": False}}})))


def message(name, performative, content, **more):
    return json.dumps({"version": 2, "id": f"{name}.{LIFE}.{next(count)}", "performative": performative, "sender": name,
                       "incarnation": LIFE, "content": content, "conversation_id": name, "language": "pddl", **more})


def beat(name, of="heartbeat"):
    agent = agents[name]
    agent["sequence"] += 1
    room = agent["config"]["location"]
    content = {"of": of, "digest": "1", "sequence": agent["sequence"], "period": hello["heartbeat_period"],
               "facts": f"(located {name} {room}) {agent['known']}"}
    return message(name, "inform", content | ({k: agent[k] for k in ("model", "methods")} if of == "model" else {}))


def hear(sample):
    heard, name = json.loads(sample.payload.to_bytes()), str(sample.key_expr).split("/")[4]
    if isinstance(heard, list):
        return
    answer = lambda what, content: session.put(f"{HOST}/{what}", message(
        name, what, content, receiver=[heard["sender"]], in_reply_to=heard["reply_with"], protocol=heard["protocol"],
        conversation_id=heard["conversation_id"]) if what != "receipt" else json.dumps([heard["id"]]))
    if heard["performative"] != "request":
        return answer("receipt", None)
    answer("agree", {"token": heard["content"]["token"]})
    if heard["id"] not in done:  # a repeated request is not performed again
        agent, room = agents[name], agents[name]["config"]["location"]
        celsius = agent["config"].get("celsius", 22.5)  # <- measure here
        agent["known"] = f"(known-temperature {room}) (= (temperature {room}) {celsius})"
        done[heard["id"]] = {"outcome": "done", "detail": f"{celsius} °C at {room}", "observations": agent["known"],
                             "action": heard["content"]["action"]}
        session.put(f"{ROOT}/model/{DAEMON}/{name}", beat(name))
    answer("confirm", done[heard["id"]])


session.declare_subscriber(f"{ROOT}/in/{DAEMON}/**", hear)
session.declare_queryable(f"{ROOT}/at/{DAEMON}/reach", lambda query: query.reply(f"{ROOT}/at/{DAEMON}/reach", ""))
session.declare_queryable(f"{ROOT}/model/{DAEMON}/*", lambda query: [  # the model of one agent, or of all
    query.reply(f"{ROOT}/model/{DAEMON}/{name}", beat(name, "model")) for name in agents
    if query.key_expr.intersects(f"{ROOT}/model/{DAEMON}/{name}")])
tokens = [session.liveliness().declare_token(f"{ROOT}/alive/{DAEMON}/{name}/{LIFE}") for name in agents]
for name in agents:
    session.put(f"{ROOT}/model/{DAEMON}/{name}", beat(name, "model"))
threading.Thread(target=lambda: (sys.stdin.read(), session.close()), daemon=True).start()  # stops when stdin ends
while not session.is_closed():
    time.sleep(hello["heartbeat_period"] / 1000)
    for name in agents:
        session.put(f"{ROOT}/model/{DAEMON}/{name}", beat(name))
