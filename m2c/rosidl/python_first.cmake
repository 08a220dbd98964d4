# Included by project() before a compiler is known. FindPython3 keeps what it asks the interpreter if it is
# asked now; asked first after that, it keeps one entry too many, takes that for another version's, and asks
# the interpreter again, in six processes for each of the dozen find_package(Python3) of an interface package.
find_package(Python3 COMPONENTS Interpreter)
