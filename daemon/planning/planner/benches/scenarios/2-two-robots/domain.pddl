; See office.rs.
(define (domain smart-office)
  (:requirements :typing :universal-preconditions :numeric-fluents :action-costs)
  (:types
    location agent preset media - object
    room corridor pose - location
    mobile-base sensor camera screen - agent
    temperature-sensor ir-temperature-sensor humidity-sensor co2-sensor light-sensor motion-sensor
    distance-sensor reflection-sensor - sensor
    ptz-camera - camera
    turtlebot video-robot - mobile-base)
  (:predicates
    (connected ?a ?b - location)
    (at ?b - mobile-base ?l - location)
    (located ?s - sensor ?r - room)
    (mounted-on ?s - sensor ?b - mobile-base)
    (dock-of ?b - mobile-base ?l - location)
    (charged ?b - mobile-base)
    (known-temperature ?r - room)
    (known-humidity ?r - room)
    (known-co2 ?r - room)
    (known-light ?r - room)
    (known-distance ?r - room)
    (known-motion ?r - room)
    (known-reflection ?r - room)
    (motion ?l - location)
    (reflection ?r - room)
    (shows ?c - camera ?p - preset ?l - location)
    (looks-at ?c - camera ?p - preset)
    (known-picture ?l - location)
    (recorded ?l - location)
    (validated ?l - location)
    (screen-in ?s - screen ?r - room)
    (allocated ?s - screen)
    (can-present ?r - room)
    (presenting ?b - mobile-base)
    (presented ?m - media ?r - room)
    (offers-go-dark ?s - screen)
    (offers-look-at ?c - ptz-camera)
    (offers-move--turtlebot-1 ?b - turtlebot)
    (offers-move--turtlebot-2 ?b - turtlebot)
    (offers-move--video-robot-1 ?b - video-robot)
    (offers-pan-left ?c - ptz-camera)
    (offers-pan-right ?c - ptz-camera)
    (offers-present--screen-1 ?s - screen)
    (offers-present--video-robot-1 ?b - video-robot)
    (offers-recharge ?b - turtlebot)
    (offers-record ?c - ptz-camera)
    (offers-report-co2 ?s - co2-sensor)
    (offers-report-temperature ?s - ir-temperature-sensor)
    (offers-stop-presenting ?b - video-robot)
    (offers-take-snapshot ?c - ptz-camera)
    (offers-tilt-down ?c - ptz-camera)
    (offers-tilt-up ?c - ptz-camera)
    (offers-validate-person ?b - turtlebot)
    (offers-zoom-in ?c - ptz-camera)
    (offers-zoom-out ?c - ptz-camera))
  (:functions
    (total-cost) - number
    (distance ?a ?b - location) - number
    (speed ?b - mobile-base) - number
    (range ?b - mobile-base) - number
    (charge ?b - mobile-base) - number
    (temperature ?r - room) - number
    (humidity ?r - room) - number
    (co2 ?r - room) - number
    (light ?r - room) - number
    (free-distance ?r - room) - number)
  (:action go-dark
    :agent ?s - screen
    :parameters (?r - room)
    :precondition (and (offers-go-dark ?s) (allocated ?s) (screen-in ?s ?r))
    :effect (and (forall (?o - media) (not (presented ?o ?r))) (increase (total-cost) 1)))
  (:action look-at
    :agent ?c - ptz-camera
    :parameters (?p - preset ?l - location)
    :precondition (and (offers-look-at ?c) (shows ?c ?p ?l))
    :effect (and
      (forall (?q - preset) (not (looks-at ?c ?q)))
      (looks-at ?c ?p)
      (increase (total-cost) 1)))
  (:action move--turtlebot-1
    :agent ?b - turtlebot
    :parameters (?from ?to - location)
    :precondition (and (offers-move--turtlebot-1 ?b) (at ?b ?from) (connected ?from ?to))
    :effect (and (not (at ?b ?from)) (at ?b ?to) (increase (total-cost) (distance ?from ?to))))
  (:action move--turtlebot-2
    :agent ?b - turtlebot
    :parameters (?from ?to - location)
    :precondition (and
      (offers-move--turtlebot-2 ?b)
      (at ?b ?from)
      (connected ?from ?to)
      (>= (charge ?b) (distance ?from ?to)))
    :effect (and
      (not (at ?b ?from))
      (at ?b ?to)
      (not (charged ?b))
      (decrease (charge ?b) (distance ?from ?to))
      (increase (total-cost) (distance ?from ?to))))
  (:action move--video-robot-1
    :agent ?b - video-robot
    :parameters (?from ?to - location)
    :precondition (and
      (offers-move--video-robot-1 ?b)
      (at ?b ?from)
      (connected ?from ?to)
      (not (presenting ?b)))
    :effect (and (not (at ?b ?from)) (at ?b ?to) (increase (total-cost) (distance ?from ?to))))
  (:action pan-left
    :agent ?c - ptz-camera
    :parameters ()
    :precondition (offers-pan-left ?c)
    :effect (and (forall (?q - preset) (not (looks-at ?c ?q))) (increase (total-cost) 1)))
  (:action pan-right
    :agent ?c - ptz-camera
    :parameters ()
    :precondition (offers-pan-right ?c)
    :effect (and (forall (?q - preset) (not (looks-at ?c ?q))) (increase (total-cost) 1)))
  (:action present--screen-1
    :agent ?s - screen
    :parameters (?m - media ?r - room)
    :precondition (and (offers-present--screen-1 ?s) (allocated ?s) (screen-in ?s ?r))
    :effect (and
      (forall (?o - media) (not (presented ?o ?r)))
      (presented ?m ?r)
      (increase (total-cost) 1)))
  (:action present--video-robot-1
    :agent ?b - video-robot
    :parameters (?m - media ?r - room)
    :precondition (and (offers-present--video-robot-1 ?b) (at ?b ?r))
    :effect (and
      (forall (?o - media) (not (presented ?o ?r)))
      (presented ?m ?r)
      (presenting ?b)
      (increase (total-cost) 5)))
  (:action recharge
    :agent ?b - turtlebot
    :parameters (?l - location)
    :precondition (and (offers-recharge ?b) (at ?b ?l) (dock-of ?b ?l))
    :effect (and (charged ?b) (assign (charge ?b) (range ?b)) (increase (total-cost) 10)))
  (:action record
    :agent ?c - ptz-camera
    :parameters (?p - preset ?l - location)
    :precondition (and (offers-record ?c) (looks-at ?c ?p) (shows ?c ?p ?l))
    :effect (and (recorded ?l) (increase (total-cost) 2)))
  (:action report-co2
    :agent ?s - co2-sensor
    :parameters (?r - room)
    :precondition (and (offers-report-co2 ?s) (located ?s ?r))
    :effect (and (known-co2 ?r) (increase (total-cost) 1)))
  (:action report-temperature
    :agent ?s - ir-temperature-sensor
    :parameters (?b - mobile-base ?r - room)
    :precondition (and (offers-report-temperature ?s) (mounted-on ?s ?b) (at ?b ?r))
    :effect (and (known-temperature ?r) (increase (total-cost) 2)))
  (:action stop-presenting
    :agent ?b - video-robot
    :parameters (?r - room)
    :precondition (and (offers-stop-presenting ?b) (at ?b ?r) (presenting ?b))
    :effect (and
      (forall (?o - media) (not (presented ?o ?r)))
      (not (presenting ?b))
      (increase (total-cost) 1)))
  (:action take-snapshot
    :agent ?c - ptz-camera
    :parameters (?p - preset ?l - location)
    :precondition (and (offers-take-snapshot ?c) (looks-at ?c ?p) (shows ?c ?p ?l))
    :effect (and (known-picture ?l) (increase (total-cost) 1)))
  (:action tilt-down
    :agent ?c - ptz-camera
    :parameters ()
    :precondition (offers-tilt-down ?c)
    :effect (and (forall (?q - preset) (not (looks-at ?c ?q))) (increase (total-cost) 1)))
  (:action tilt-up
    :agent ?c - ptz-camera
    :parameters ()
    :precondition (offers-tilt-up ?c)
    :effect (and (forall (?q - preset) (not (looks-at ?c ?q))) (increase (total-cost) 1)))
  (:action validate-person
    :agent ?b - turtlebot
    :parameters (?l - location)
    :precondition (and (offers-validate-person ?b) (at ?b ?l))
    :effect (and (validated ?l) (increase (total-cost) 5)))
  (:action zoom-in
    :agent ?c - ptz-camera
    :parameters ()
    :precondition (offers-zoom-in ?c)
    :effect (and (forall (?q - preset) (not (looks-at ?c ?q))) (increase (total-cost) 1)))
  (:action zoom-out
    :agent ?c - ptz-camera
    :parameters ()
    :precondition (offers-zoom-out ?c)
    :effect (and (forall (?q - preset) (not (looks-at ?c ?q))) (increase (total-cost) 1))))
