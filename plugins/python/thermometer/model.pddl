(define (agent {{ agent }}) (:domain smart-office)
  (:objects {{ agent }} - temperature-sensor)
  (:init (located {{ agent }} {{ config.location }}))
  (:action report-temperature
    :agent ?s - temperature-sensor
    :parameters (?r - room)
    :precondition (located ?s ?r)
    :effect (and (known-temperature ?r) (increase (total-cost) 1))
    :observe (temperature ?r)))
