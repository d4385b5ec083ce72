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
    location agent - object

    room                      ; people want to know something about it
    corridor - location       ; robots pass through it

    mobile-base               ; moves, and carries others
    sensor - agent            ; measures, and moves nothing

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
    (motion ?r - room)                  ; somebody moves there
    (reflection ?r - room))             ; something is right before the sensor

  (:functions
    (total-cost)                        ; what a plan costs: meters and efforts
    (distance ?a ?b - location)         ; in meters; the map says it
    (speed ?b - mobile-base)            ; in meters per second; the base says it
    (temperature ?r - room)             ; in °C; whoever measured it says it, and so on:
    (humidity ?r - room)                ; relative, in %
    (co2 ?r - room)                     ; in ppm
    (light ?r - room)                   ; in lx
    (free-distance ?r - room)))         ; before the IR distance sensor, in meters
