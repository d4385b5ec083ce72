(define (problem bring-the-box) (:domain parcel-apart)
  (:objects
    gate - door
    (:private brass iron - key))
  (:init (hangs brass) (hangs iron) (fits brass gate))
  (:goal (and)))
