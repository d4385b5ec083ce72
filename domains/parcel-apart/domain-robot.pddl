; A robot that carries parcels through doors. Where it stands, what it holds and how far its battery
; reaches is its own business.
(define (domain parcel-apart)
  (:requirements :typing :factored-privacy)
  (:types room parcel door cell - object)
  (:predicates
    (parcel-at ?p - parcel ?r - room)
    (open ?d - door)
    (leads ?d - door ?a ?b - room)
    (:private
      (standing ?r - room)
      (holding ?p - parcel)
      (hands-free)
      (charge ?c - cell)
      (next ?c ?d - cell)))
  (:action drive
    :parameters (?a ?b - room ?d - door ?c ?e - cell)
    :precondition (and (standing ?a) (leads ?d ?a ?b) (open ?d) (charge ?c) (next ?c ?e))
    :effect (and (standing ?b) (not (standing ?a)) (charge ?e) (not (charge ?c))))
  (:action take
    :parameters (?p - parcel ?r - room)
    :precondition (and (standing ?r) (parcel-at ?p ?r) (hands-free))
    :effect (and (holding ?p) (not (parcel-at ?p ?r)) (not (hands-free))))
  (:action put
    :parameters (?p - parcel ?r - room)
    :precondition (and (standing ?r) (holding ?p))
    :effect (and (hands-free) (parcel-at ?p ?r) (not (holding ?p)))))
