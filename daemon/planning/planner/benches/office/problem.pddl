(define (problem office-morning)
  (:domain office)
  (:objects
    hall - corridor
    office1 office2 office3 lab kitchen - room
    thermo1 thermo2 - temperature-sensor
    turtlebot-1 turtlebot-2 - turtlebot
    ir-1 ir-2 - ir-sensor)
  (:init
    (at turtlebot-1 hall) (at turtlebot-2 lab)
    (located thermo1 office1) (located thermo2 office2)
    (mounted-on ir-1 turtlebot-1) (mounted-on ir-2 turtlebot-2)
    (connected hall office1) (connected office1 hall)
    (connected hall office2) (connected office2 hall)
    (connected hall office3) (connected office3 hall)
    (connected hall lab) (connected lab hall)
    (connected hall kitchen) (connected kitchen hall)
    (= (distance hall office1) 4) (= (distance office1 hall) 4)
    (= (distance hall office2) 6) (= (distance office2 hall) 6)
    (= (distance hall office3) 8.5) (= (distance office3 hall) 8.5)
    (= (distance hall lab) 3) (= (distance lab hall) 3)
    (= (distance hall kitchen) 12) (= (distance kitchen hall) 12)
    (= (total-cost) 0))
  (:goal (forall (?r - room) (known-temperature ?r)))
  (:metric minimize (total-cost)))
