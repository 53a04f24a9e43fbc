"""Captions of a contest's tables and figures."""

MEASURED = (
    "A search is a success where a robot comes within 0.25 m of a source before the scenario's time is over; the robot "
    "itself does not know, and stops. NAME_declares is the algorithm NAME taken at its word: there a success is a "
    "robot that says where a source is and is right by 0.25 m, and its first word ends the search, right or wrong. "
    "Time and way are those of successes; time with failures counts a failure as the whole time. "
    "Way / shortest way: what the robot drove over the shortest way that it could have driven from its start to the "
    "nearest source, around what stands.",
    "Algorithms that know when they are done declare a place. Localisation error: from the declared place to the "
    "nearest source, of the first right declaration of a search or, without one, of its last; a declaration is false "
    "where no source is within 0.25 m of it. Of every search: declared (a robot said rightly where a source is), "
    "reached (none did, but one came to a source), neither. "
    "What stops at a source before it is sure of it has no word to be judged: look at NAME_declares for that.",
    "Intervals have 95 % confidence and are over airs: searches in one air share its luck, so that whole airs are "
    "drawn again and again with all their searches (cluster bootstrap). Where each air was searched once, where all "
    "airs agree, or where there are fewer than five, success has Wilson's interval, in which each air counts once. "
    "Where chance does not change the air, it is Wilson's over the searches.",
    "All algorithms have the same robot, sensors, time, airs and starts: start k of air n is the same place for all of "
    "them. They search alone, DAPSO with five robots, as a swarm of one is none; its time is that of the first. "
    "All have their shipped defaults, but for the facts of the plume that they get: threshold_ppm, a tenth of the "
    "highest mean concentration where robots start, at least 2 ppm, and the mean speed of the wind.",
)
WHOLE = (
    "In brackets the 95 % interval over airs. The last column is the plain mean over the scenarios; random_walk is the "
    "floor: who does no better learns nothing from the gas."
)
FACTS = "Facts of the plume that all are given:"
ARENA = (
    "Mean gas at the sensors' height in the first minute of the first air, logarithmic; stars are sources."
)
COMPARED = "Means with intervals of 95 % confidence over airs. A time of few successes is uncertain."
TABLE = "In brackets the intervals of 95 % confidence over airs; none where there is nothing to count."
WORDS = "Of algorithms that have declared a place: how far it was from the nearest source, and how searches ended."
FAILED = "Failed runs count as nothing, neither as found nor as not found."
