; The standard ontology: the words that the agents of a normal building speak.
;
; It says what kinds of things there are and what can be said about them. It has
; NO actions: each agent brings its own in its action model, so that what a
; building can do is exactly what the agents in it can do. An agent may add types
; below these, and predicates of its own; where its words differ from these,
; these win. The name is that of the paper's building, so that the models of agents
; that were written for it fit every other one. A building that needs more words names a `vocabulary` in its
; ecosystem file (docs/building.md).
(define (domain smart-office)

  ; What agents and goals may use. `:universal-preconditions` is for goals such as
  ; (forall (?r - room) (known-temperature ?r)), `:disjunctive-preconditions` for
  ; those that say `imply`, such as the rooms of one floor.
  (:requirements :typing :universal-preconditions :existential-preconditions
    :disjunctive-preconditions :derived-predicates :numeric-fluents :action-costs)

  ; `a b - c` reads: every a is a c, and so is every b.
  (:types
    location agent floor preset media item mode color - object

    ; ── Places: the kinds that [rooms] of an ecosystem file may name ──
    room                      ; people want to know something about it
    corridor                  ; robots pass through it
    outdoors                  ; a garden, a yard, a street: neither of the two
    pose - location           ; a spot that a mobile base knows by itself

    office meeting-room kitchen bathroom bedroom living-room store-room
    technical-room - room

    hall stairs passage       ; people and robots go through it
    airlock                   ; lets one pass in one direction only
    lift                      ; has a door on each floor; robots ride in it
      - corridor

    ; ── Agents ──
    mobile-base               ; moves, and carries others
    sensor                    ; measures, and moves nothing
    camera                    ; sees, in the directions of its presets
    screen                    ; shows media to the people in its room
    lamp relay door-lock cover gate fan thermostat humidifier - agent

    temperature-sensor        ; fixed in the room that it measures
    ir-temperature-sensor     ; mounted on a mobile base, measures where that is
    humidity-sensor co2-sensor light-sensor     ; fixed, as the first
    motion-sensor             ; says by itself when somebody moves
    distance-sensor           ; IR: how far it is to the next thing before it
    reflection-sensor         ; IR: whether something is right before it
    contact-sensor            ; at a door or a window: whether that is closed
    meter                     ; electricity: power and energy of the device that it is in
      - sensor)

  (:predicates
    ; ── Places: the map says these ──
    (connected ?a ?b - location)        ; one can go from a to b, not always back
    (on-floor ?l - location ?f - floor)
    (staff-only ?l - location)          ; visitors have no business there

    ; ── Agents: they say these about themselves ──
    (at ?b - mobile-base ?l - location)
    (located ?s - sensor ?r - room)
    (mounted-on ?s - sensor ?b - mobile-base)
    (installed ?d - object ?r - room)         ; a lamp, a lock, a cover, a thermostat …
    (dock-of ?b - mobile-base ?l - location)  ; its battery is filled there
    (charged ?b - mobile-base)                ; its battery is full

    ; ── Measuring ──
    ; Measuring makes these true. They do not say what was measured: planning
    ; needs to know THAT a temperature will be known, not which it will be.
    (known-temperature ?r - room)
    (known-humidity ?r - room)
    (known-co2 ?r - room)
    (known-light ?r - room)
    (known-distance ?r - room)
    (known-motion ?r - room)
    (known-reflection ?r - room)
    (known-contact ?r - room)
    (known-power ?d - object)
    (known-energy ?d - object)

    ; What is yes or no, or unknown: a sensor that cannot tell says (unknown (motion hall)).
    (motion ?l - location)              ; somebody moves there: sensors and cameras say it
    (reflection ?r - room)              ; something is right before the sensor
    (contact-at ?s - sensor ?r - room)  ; the sensor is at a door or window of the room
    (shut ?s - sensor)                  ; which is closed
    (closed ?r - room)                  ; all doors and windows with a contact are: see below

    ; ── Lamps, sockets, locks, covers, air ──
    ; The first of each line is of the room, and follows from the second, of the thing.
    (lit ?r - room)          (lamp-on ?d - lamp)
    (powered ?r - room)      (relay-on ?d - relay)
    (locked ?r - room)       (bolted ?d - door-lock)        ; all locks of the room are
    (covers-open ?r - room)  (cover-open ?d - cover)
    (gates-open ?r - room)   (gate-open ?d - gate)
    (ventilated ?r - room)   (fan-on ?d - fan)
    (humidified ?r - room)   (humidifier-on ?d - humidifier)
    (lamp-color ?d - object ?o - color)
    (fan-mode ?d - object ?o - mode)
    (thermostat-mode ?d - object ?o - mode)

    ; ── Cameras: pictures and recordings ──
    (shows ?c - camera ?p - preset ?l - location)
    (looks-at ?c - camera ?p - preset)
    (known-picture ?l - location)       ; a picture was taken, and still counts
    (recorded ?l - location)            ; a video was

    ; ── People who log in: whoever can ask a person says it ──
    (validated ?l - location)           ; somebody logged in there lately

    ; ── Robots: patrols, cleaning, carrying ──
    (patrolled ?l - location)           ; a mobile base looked around there lately
    (swept ?l - location)
    (item-at ?i - item ?l - location)
    (carrying ?b - mobile-base ?i - item)

    ; ── Screens, and robots that have one ──
    (screen-in ?s - screen ?r - room)
    (allocated ?s - screen)             ; it has what it needs to show anything
    (can-present ?r - room)
    (presenting ?b - mobile-base)       ; it stays, because it shows something
    (presented ?m - media ?r - room))

  (:functions
    (total-cost)                        ; what a plan costs: meters and efforts

    ; ── Places ──
    (distance ?a ?b - location)         ; in meters; the map says it
    (area ?l - location)                ; in square meters; the map says it

    ; ── Robots ──
    (speed ?b - mobile-base)            ; in meters per second; the base says it
    (range ?b - mobile-base)            ; meters a full battery lasts; the base says it
    (charge ?b - mobile-base)           ; meters its battery lasts now; the base says it

    ; ── Measured in a room: whoever measured it says it ──
    (temperature ?r - room)             ; in °C
    (humidity ?r - room)                ; relative, in %
    (co2 ?r - room)                     ; in ppm
    (light ?r - room)                   ; in lx
    (free-distance ?r - room)           ; before the IR distance sensor, in meters
    (power ?d - object)                 ; in W
    (energy ?d - object)                ; in kWh

    ; ── Set at a thing ──
    (brightness ?d - object)            ; in %, of a lamp; 0 if it is off
    (color-temperature ?d - object)     ; in K, of a lamp
    (cover-position ?d - object)        ; in %; 0 is closed, 100 is open
    (cover-tilt ?d - object)            ; in %
    (gate-position ?d - object)         ; in %
    (fan-speed ?d - object)             ; in %
    (target-temperature ?d - object)    ; in °C, of a thermostat that heats
    (cooling-temperature ?d - object)   ; in °C, of a thermostat that cools
    (target-humidity ?d - object))      ; in %

  ; A room is closed if each of its contacts says so.
  (:derived (closed ?r - room)
    (and (exists (?s - sensor) (contact-at ?s ?r))
         (forall (?s - sensor) (imply (contact-at ?s ?r) (shut ?s)))))

  ; One lamp that is on lights its room, and so on; a room is locked if all its locks are.
  (:derived (lit ?r - room)
    (exists (?d - lamp) (and (installed ?d ?r) (lamp-on ?d))))
  (:derived (powered ?r - room)
    (exists (?d - relay) (and (installed ?d ?r) (relay-on ?d))))
  (:derived (locked ?r - room)
    (and (exists (?d - door-lock) (installed ?d ?r))
         (forall (?d - door-lock) (imply (installed ?d ?r) (bolted ?d)))))
  (:derived (covers-open ?r - room)
    (exists (?d - cover) (and (installed ?d ?r) (cover-open ?d))))
  (:derived (gates-open ?r - room)
    (exists (?d - gate) (and (installed ?d ?r) (gate-open ?d))))
  (:derived (ventilated ?r - room)
    (exists (?d - fan) (and (installed ?d ?r) (fan-on ?d))))
  (:derived (humidified ?r - room)
    (exists (?d - humidifier) (and (installed ?d ?r) (humidifier-on ?d)))))
