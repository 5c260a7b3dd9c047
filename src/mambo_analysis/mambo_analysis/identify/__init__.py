"""
Parameters of a vehicle and of its sensors from recordings, each with its interval.

Each parameter has a module: a function from arrays to a result, and the command. Common parts are
in ``regression`` (fits and intervals), ``columns`` (arrays from files) and ``result`` (output of a
command); ``sensors`` also uses ``allan`` and ``recording``.
"""
