; What only a hospital ward has: the words that it adds to the standard ontology
; (daemon/language/ontology/src/standard.pddl). `vocabulary` of ecosystems/ward.toml
; names this file.
(define (domain ward)

  ; `a b - c` reads: every a is a c, and so is every b.
  (:types
    patient-room              ; somebody lies there
    isolation-room            ; entered through an airlock, left through another
      - room))
