"""From a policy file to a robot that runs.

Every millisecond a state comes and a command leaves (``messages``), over shared memory or Unitree's DDS
(``transports``). The ``controller`` is a state machine with the policy in it; a person or a script says how
fast to run (``operators``). The ``guard`` judges all that comes and limits all that leaves. The ``simulator``
is a robot behind the same transports; the ``log`` keeps every step.
"""
