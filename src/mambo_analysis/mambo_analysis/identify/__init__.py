"""
Parameters of a vehicle and of its sensors from recordings, each with its interval.

One module for each: a function from arrays to a result, and the command on top of it. What they
share is in ``regression`` (fits and their intervals), ``columns`` (arrays out of files) and
``report`` (what a command writes); ``sensors`` has ``allan`` and ``recording`` of its own.
"""
