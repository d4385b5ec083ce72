(define (problem bring-the-box) (:domain parcel-apart)
  (:objects
    hall lab - room
    box - parcel
    gate - door
    (:private full half empty - cell))
  (:init
    (parcel-at box lab)
    (leads gate hall lab) (leads gate lab hall)
    (standing hall) (hands-free)
    (charge full) (next full half) (next half empty))
  (:goal (parcel-at box hall)))
