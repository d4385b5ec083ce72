; The paper's test bed: two offices, one conference room, one corridor.
;
; Only what no agent brings: the places, the doors and how far it is. Sensors and
; robots are not here; they announce themselves when they are switched on.
;
; To make it your own building: rename, add or remove places under `:objects`,
; then write every way between two neighbors twice under `:init`, once in each
; direction (only once where one cannot go back).
(define (problem smart-office-map)
  (:domain smart-office)

  (:objects
    office1 office2 conf-room - room
    corridor - corridor)

  (:init
    (= (total-cost) 0)        ; a plan costs nothing before its first step

    ; Every room has one door, to the corridor. Distances are in meters.
    (connected corridor office1)   (= (distance corridor office1) 4)
    (connected office1 corridor)   (= (distance office1 corridor) 4)

    (connected corridor office2)   (= (distance corridor office2) 6)
    (connected office2 corridor)   (= (distance office2 corridor) 6)

    (connected corridor conf-room) (= (distance corridor conf-room) 8)
    (connected conf-room corridor) (= (distance conf-room corridor) 8))

  ; No goal stands in the map: people and agents ask for goals while it runs.
  (:goal (and))

  ; Of two plans, the one that costs less.
  (:metric minimize (total-cost)))
