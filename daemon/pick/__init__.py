"""The pick: its states, what it has observed, the part that it follows, how it takes and sets down.

Recognition is daemon/vision/'s, every motion daemon/arm/'s. planning/ decides before anything moves, grippers/ has the
kinds of gripper; the handlers here carry a plan out.
"""
