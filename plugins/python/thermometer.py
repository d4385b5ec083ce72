#!/usr/bin/env python3
"""An agent in Python: a thermometer that joins an ecosystem, takes part in plans, and measures on request.

usage: thermometer.py ECOSYSTEM ENDPOINT NAME ROOM    (pip install eclipse-zenoh; the protocol: docs/protocol.md)

ENDPOINT is that of a daemon, such as unixsock-stream//run/althing/office/office-pi.sock. MEASURE returns the value.
"""
import json, sys, threading, time
import zenoh

ECOSYSTEM, ENDPOINT, NAME, ROOM = sys.argv[1:5]
MEASURE = lambda: 22.5
ROOT, DAEMON, LIFE = f"althing/{ECOSYSTEM}", f"{NAME}-py", time.time_ns() // 1000
MODEL = f"""(define (agent {NAME}) (:domain smart-office)
  (:objects {NAME} - temperature-sensor) (:init (located {NAME} {ROOM}))
  (:action report-temperature :agent ?s - temperature-sensor :parameters (?r - room)
    :precondition (located ?s ?r) :effect (and (known-temperature ?r) (increase (total-cost) 1))
    :observe (temperature ?r)))"""
METHODS = {"report-temperature": {"method": "read_temperature", "arguments": {}, "timeout": 2000}}
state = {"facts": f"(located {NAME} {ROOM})", "sequence": 0, "messages": 0}
hosts, done = {}, {}
session = zenoh.open(zenoh.Config.from_json5(json.dumps(
    {"mode": "client", "connect": {"endpoints": [ENDPOINT]}, "scouting": {"multicast": {"enabled": False}}})))


def message(performative, content, **more):
    state["messages"] += 1
    return {"version": 2, "id": f"{NAME}.{LIFE}.{state['messages']}", "performative": performative, "sender": NAME,
            "incarnation": LIFE, "content": content, "conversation_id": NAME, "language": "pddl", **more}


def beat(of="heartbeat"):
    state["sequence"] += 1
    more = {"model": MODEL, "methods": METHODS} if of == "model" else {}
    content = {"of": of, "digest": "1", "sequence": state["sequence"], "facts": state["facts"], "period": 1000, **more}
    return json.dumps(message("inform", content))


def answer(to, performative, content):
    say(to["sender"], performative, json.dumps(message(
        performative, content, receiver=[to["sender"]], conversation_id=to["conversation_id"],
        in_reply_to=to.get("reply_with") or to["in_reply_to"], protocol=to["protocol"])))


def say(agent, what, payload):
    if agent in hosts:
        session.put(f"{ROOT}/in/{hosts[agent]}/{agent}/{what}", payload)


def hear(sample):
    heard = json.loads(sample.payload.to_bytes())
    if isinstance(heard, list):  # receipts; not needed: this agent never resends a message
        return
    token = json.dumps(heard.get("content", {}).get("token"), sort_keys=True)
    if heard["performative"] == "cfp":
        goal, part = f"(known-temperature {ROOM})", heard["content"].get("part")
        if part:  # its part of a joint plan: it can measure at any time, whatever others do
            own = " ".join(step["own"] for step in part["steps"] if "own" in step)
            plan = {"covers": heard["content"]["conjuncts"], "plan": own, "cost": 1.0}
            answer(heard, "agree", {"proposals": [plan], "domain_digest": "1", "agreed": part["digest"]})
        elif goal in heard["content"]["conjuncts"]:
            plan = {"covers": [goal], "plan": f"(report-temperature {NAME} {ROOM})", "cost": 1.0}
            answer(heard, "agree", {"proposals": [plan], "domain_digest": "1"})
        else:
            answer(heard, "refuse", {"reason": "incapable", "detail": f"I measure the temperature of {ROOM}"})
    elif heard["performative"] == "request" and heard["content"].get("act") == "act":
        answer(heard, "agree", {"token": heard["content"]["token"]})
        if token not in done:  # at most once: a repeated request gets the same result
            celsius = MEASURE()
            facts = f"(known-temperature {ROOM}) (= (temperature {ROOM}) {celsius})"
            done[token] = {"outcome": "done", "detail": f"{celsius} °C at {ROOM}", "observations": facts,
                           "action": heard["content"]["action"]}
            state["facts"] = f"(located {NAME} {ROOM}) {facts}"
            session.put(f"{ROOT}/model/{DAEMON}/{NAME}", beat())
        answer(heard, "confirm", done[token])
    elif heard.get("receiver"):  # any other message needs a receipt and no answer
        say(heard["sender"], "receipt", json.dumps([heard["id"]]))


def met(sample):
    daemon, agent = str(sample.key_expr).split("/")[3:5]
    hosts[agent] = daemon


session.liveliness().declare_subscriber(f"{ROOT}/alive/**", met, history=True)
session.declare_subscriber(f"{ROOT}/in/{DAEMON}/**", hear)
session.declare_subscriber(f"{ROOT}/all/cfp/**", hear)
session.declare_queryable(f"{ROOT}/at/{DAEMON}/reach", lambda query: query.reply(f"{ROOT}/at/{DAEMON}/reach", ""))
session.declare_queryable(
    f"{ROOT}/model/{DAEMON}/*", lambda query: query.reply(f"{ROOT}/model/{DAEMON}/{NAME}", beat("model")))
token = session.liveliness().declare_token(f"{ROOT}/alive/{DAEMON}/{NAME}/{LIFE}")
session.put(f"{ROOT}/model/{DAEMON}/{NAME}", beat("model"))
print(f"{NAME} is here", flush=True)
while True:
    time.sleep(1)
    session.put(f"{ROOT}/model/{DAEMON}/{NAME}", beat())
