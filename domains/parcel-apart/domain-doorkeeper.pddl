; A doorkeeper who opens doors. Which key fits, and where it hangs, is nobody else's business.
(define (domain parcel-apart)
  (:requirements :typing :factored-privacy)
  (:types door key - object)
  (:predicates
    (open ?d - door)
    (:private
      (hangs ?k - key)
      (pocketed ?k - key)
      (fits ?k - key ?d - door)
      (unlocked ?d - door)))
  (:action fetch
    :parameters (?k - key)
    :precondition (hangs ?k)
    :effect (and (pocketed ?k) (not (hangs ?k))))
  (:action unlock
    :parameters (?d - door ?k - key)
    :precondition (and (pocketed ?k) (fits ?k ?d))
    :effect (unlocked ?d))
  (:action swing
    :parameters (?d - door)
    :precondition (unlocked ?d)
    :effect (open ?d)))
