"""
Elementary functions and random numbers that are the same bits on every machine.

Those of the C library differ in the last bit from one processor or version to the next. These use
IEEE 754 addition, multiplication, division and square root alone, without fused operations, so
that a flight does not depend on the machine that computes it. Each elementary function is within
1 ulp (unit in the last place) of the true value. The methods are Cody and Waite's reduction of
arguments, Dekker's and Knuth's sums and products in two doubles, Tang's tables of accurate values,
and Taylor series: J.-M. Muller, Elementary Functions, 3rd ed., Birkhaeuser 2016.
"""
