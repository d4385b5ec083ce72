; A small office: rooms along a corridor, sensors on walls and on a robot's back.
(define (domain office)
  (:requirements :typing :multi-agent :universal-preconditions :action-costs)
  (:types
    location agent - object
    room corridor - location
    turtlebot temperature-sensor ir-sensor - agent)
  (:predicates
    (at ?r - turtlebot ?l - location)
    (connected ?from ?to - location)
    (located ?s - temperature-sensor ?r - room)
    (mounted-on ?s - ir-sensor ?b - turtlebot)
    (known-temperature ?r - room))
  (:functions (distance ?from ?to - location) (total-cost))
  (:action move
    :agent ?r - turtlebot
    :parameters (?from ?to - location)
    :precondition (and (at ?r ?from) (connected ?from ?to))
    :effect (and (not (at ?r ?from)) (at ?r ?to) (increase (total-cost) (distance ?from ?to))))
  (:action report-temperature
    :agent ?s - temperature-sensor
    :parameters (?r - room)
    :precondition (located ?s ?r)
    :effect (known-temperature ?r))
  (:action measure-temperature
    :agent ?s - ir-sensor
    :parameters (?b - turtlebot ?r - room)
    :precondition (and (mounted-on ?s ?b) (at ?b ?r))
    :effect (and (known-temperature ?r) (increase (total-cost) 1))))
