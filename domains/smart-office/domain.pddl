; The shared ontology of the smart office: the words that all its agents speak.
;
; It says what kinds of things there are and what can be said about them. It has
; NO actions: each agent brings its own in its action model, so that what the
; office can do is exactly what the agents in it can do. An agent may add types
; below these, and predicates of its own; where its words differ from these,
; these win.
;
; To change it: add a type, a predicate or a function below, then use it in a
; map, in an agent's action model, or in a goal. `althing check FILE` tells at
; once whether everything still fits.
(define (domain smart-office)

  ; What agents and goals of this office may use. `:universal-preconditions` is
  ; for goals such as (forall (?r - room) (known-temperature ?r)).
  (:requirements :typing :universal-preconditions :numeric-fluents :action-costs)

  ; `a b - c` reads: every a is a c, and so is every b.
  (:types
    location agent preset media - object

    room                      ; people want to know something about it
    corridor - location       ; robots pass through it
    pose - location           ; a spot that a mobile base knows by itself

    mobile-base               ; moves, and carries others
    sensor                    ; measures, and moves nothing
    camera                    ; sees, in the directions of its presets
    screen - agent            ; shows media to the people in its room

    temperature-sensor        ; fixed in the room that it measures
    ir-temperature-sensor     ; mounted on a mobile base, measures where that is
    humidity-sensor co2-sensor light-sensor     ; fixed, as the first
    motion-sensor             ; says by itself when somebody moves
    distance-sensor           ; IR: how far it is to the next thing before it
    reflection-sensor         ; IR: whether something is right before it
      - sensor)

  (:predicates
    ; The map says these. A door is passed one way only where only one is given.
    (connected ?a ?b - location)

    ; The agents say these about themselves.
    (at ?b - mobile-base ?l - location)
    (located ?s - sensor ?r - room)
    (mounted-on ?s - sensor ?b - mobile-base)
    (dock-of ?b - mobile-base ?l - location)  ; its battery is filled there
    (charged ?b - mobile-base)                ; its battery is full

    ; Measuring makes this true. It does not say what was measured: planning
    ; needs to know THAT a temperature will be known, not which it will be.
    (known-temperature ?r - room)

    ; The same of what else is measured in a room.
    (known-humidity ?r - room)
    (known-co2 ?r - room)
    (known-light ?r - room)
    (known-distance ?r - room)
    (known-motion ?r - room)
    (known-reflection ?r - room)

    ; What is yes or no. Where it is known and not said, it is not so.
    (motion ?l - location)              ; somebody moves there: sensors and cameras say it
    (reflection ?r - room)              ; something is right before the sensor

    ; Cameras say these: which preset shows what, and what they saw there.
    (shows ?c - camera ?p - preset ?l - location)
    (looks-at ?c - camera ?p - preset)
    (known-picture ?l - location)       ; a picture was taken, and still counts
    (recorded ?l - location)            ; a video was

    ; Whoever can ask a person says this: somebody logged in there lately.
    (validated ?l - location)

    ; A mobile base says this of where it looked around lately.
    (patrolled ?l - location)

    ; Screens say these, and robots that have one.
    (screen-in ?s - screen ?r - room)
    (allocated ?s - screen)             ; it has what it needs to show anything
    (can-present ?r - room)
    (presenting ?b - mobile-base)       ; it stays, because it shows something
    (presented ?m - media ?r - room))

  (:functions
    (total-cost)                        ; what a plan costs: meters and efforts
    (distance ?a ?b - location)         ; in meters; the map says it
    (speed ?b - mobile-base)            ; in meters per second; the base says it
    (range ?b - mobile-base)            ; meters a full battery lasts; the base says it
    (charge ?b - mobile-base)           ; meters its battery lasts now; the base says it
    (temperature ?r - room)             ; in °C; whoever measured it says it, and so on:
    (humidity ?r - room)                ; relative, in %
    (co2 ?r - room)                     ; in ppm
    (light ?r - room)                   ; in lx
    (free-distance ?r - room)))         ; before the IR distance sensor, in meters
