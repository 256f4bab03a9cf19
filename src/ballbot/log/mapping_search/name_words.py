"""The words and units that names of foreign columns are made of; `ballbot.log.mapping_search.names` reads them.

English and German; words of other languages are translated (`TRANSLATED`).
"""

from __future__ import annotations

from typing import Literal

InputKind = Literal["torque", "current", "voltage", "duty"]

#: by unit, how names write it: lower case, without separators
UNITS: dict[str, tuple[str, ...]] = {
    "s": (
        "s",
        "sec",
        "secs",
        "second",
        "seconds",
        "sek",
        "sekunden",
        "seconden",
        "secondi",
        "segundos",
        "secondes",
    ),
    "ms": ("ms", "msec", "millis", "milliseconds", "millisec"),
    "us": ("us", "usec", "micros", "microseconds", "µs", "μs"),
    "ns": ("ns", "nsec", "nanos", "nanoseconds", "nanosec"),
    "rad": ("rad", "rads", "radian", "radians"),
    "deg": ("deg", "degs", "degree", "degrees", "°", "grad", "graden", "grader", "gradi", "grados", "graus"),
    "mrad": ("mrad", "mrads", "milliradians"),
    "cdeg": ("cdeg", "cdegs", "centideg", "centidegrees"),
    "turn": ("turn", "turns", "rev", "revs", "revolutions", "umdrehungen", "omwentelingen", "varv", "giri"),
    "counts": ("count", "counts", "cnt", "cnts", "tick", "ticks", "pulses", "pulsen", "pulser", "pulsos"),
    "rad/s": ("rad/s", "radps", "radpers", "radpersec", "radpersecond"),
    "deg/s": ("deg/s", "dps", "degps", "degpers", "degpersec", "degreespersecond", "°/s"),
    "mdeg/s": ("mdeg/s", "mdps", "mdegps"),
    "mrad/s": ("mrad/s", "mradps"),
    "rpm": ("rpm", "revpermin", "u/min", "tr/min", "varv/min", "giri/min", "obr/min"),
    "turn/s": ("turn/s", "turns/s", "rev/s", "revs/s", "revps", "revpersec", "revpers"),
    # revolutions or radians a second, as teams write it for either: a unit that the name leaves open
    "rps": ("rps",),
    "counts/s": ("counts/s", "countspersec", "countspers", "ticks/s", "tickspersec", "cps"),
    "A": ("a", "amp", "amps", "ampere", "amperes"),
    "mA": ("ma", "milliamp", "milliamps"),
    "V": ("v", "volt", "volts"),
    "mV": ("mv", "millivolt", "millivolts"),
    "N m": ("nm", "newtonmeter", "newtonmeters", "newtonmetre"),
    "mN m": ("mnm",),
    "N cm": ("ncm",),
    "%": ("%", "pct", "percent", "perc"),
    "m": ("m", "meter", "meters", "metre", "metres"),
    "cm": ("cm",),
    "mm": ("mm",),
    "m/s": ("m/s", "mps", "mpers"),
    "mm/s": ("mm/s", "mmps"),
    "m/s^2": ("m/s^2", "m/s2", "mps2", "ms2", "m/s²", "mss"),
    "g": ("g", "gs"),
}
UNIT_OF = {spelling: unit for unit, spellings in UNITS.items() for spelling in spellings}
#: names may spell the slash of these as a separator: gyro_x_rad_s
SPLIT_UNITS = {
    ("rad", "s"): "rad/s",
    ("rad", "sec"): "rad/s",
    ("rad", "per", "s"): "rad/s",
    ("rad", "per", "sec"): "rad/s",
    ("deg", "s"): "deg/s",
    ("deg", "sec"): "deg/s",
    ("deg", "per", "s"): "deg/s",
    ("deg", "per", "sec"): "deg/s",
    ("mdeg", "s"): "mdeg/s",
    ("mrad", "s"): "mrad/s",
    ("rev", "s"): "turn/s",
    ("turn", "s"): "turn/s",
    ("turns", "s"): "turn/s",
    ("counts", "s"): "counts/s",
    ("counts", "per", "s"): "counts/s",
    ("ticks", "s"): "counts/s",
    ("m", "s"): "m/s",
    ("mm", "s"): "mm/s",
    ("m", "s", "2"): "m/s^2",
    ("m", "s2"): "m/s^2",
    ("n", "m"): "N m",
    ("mn", "m"): "mN m",
    ("n", "cm"): "N cm",
}
ANGLE = ("rad", "deg", "turn", "counts")
RATE = ("rad/s", "deg/s", "mdeg/s", "mrad/s", "rpm", "turn/s", "rps", "counts/s")
#: units that a kind can have
UNITS_OF_KIND: dict[str, tuple[str, ...]] = {
    "time": ("s", "ms", "us", "ns"),
    "attitude": ("rad", "deg", "mrad", "cdeg"),
    "gyro": ("rad/s", "deg/s", "mdeg/s", "mrad/s"),
    "accelerometer": ("m/s^2", "g"),
    "wheel angle": (*ANGLE, "mm"),  # of path
    "wheel speed": RATE,
    "command": ("N m", "mN m", "N cm", "A", "mA", "V", "mV", "%"),
    "ball position": ("m", "cm", "mm"),
    "ball velocity": ("m/s", "mm/s"),
}
#: what a unit says of a command
INPUT_OF_UNIT: dict[str, InputKind] = {
    "N m": "torque",
    "mN m": "torque",
    "N cm": "torque",
    "A": "current",
    "mA": "current",
    "V": "voltage",
    "mV": "voltage",
    "%": "duty",
}

REFERENCE = {
    "ref",
    "reference",
    "target",
    "tgt",
    "setpoint",
    "sp",
    "des",
    "desired",
    "goal",
    "wanted",
    "traj",
}
#: never a measurement of what Ballbot uses
OTHER = {
    *("err", "error", "kp", "ki", "kd", "gain", "gains", "bat", "batt", "battery", "vbat", "supply", "temp", "bus"),
    *("temperature", "mag", "magnetometer", "status", "state", "mode", "abort", "flag", "cost", "cpu", "bias", "std"),
    *("akku", "batterie", "temperatur", "fehler", "zustand"),
    *("var", "cov", "integral", "est", "dt", "period", "latency", "load", "checksum", "crc", "joy", "joystick"),
}  # fmt: skip
TIME = {
    "zeit",
    "zeitstempel",
    "uhrzeit",
    "time",
    "timestamp",
    "stamp",
    "clock",
    "elapsed",
    "utime",
    "tsec",
    "tnow",
    "seconds",
    "millis",
    "micros",
    "ts",
}
COUNTER = {
    "i",
    "n",
    "k",
    "idx",
    "index",
    "seq",
    "sequence",
    "counter",
    "frame",
    "sample",
    "iteration",
    "iter",
    "row",
}
ANGLE_WORDS = {"roll": "x", "pitch": "y", "yaw": "z", "heading": "z"} | {
    "rollwinkel": "x",
    "nickwinkel": "y",
    "gierwinkel": "z",
}
ATTITUDE = {
    "theta",
    "imu",
    "lean",
    "rpy",
    "angle",
    "ang",
    "tilt",
    "euler",
    "att",
    "attitude",
    "th",
    "orientation",
}
GYRO = {"gyro", "gyr", "gyroscope", "gyroskop", "drehrate"}
RATES = {"omega", "w", "rate", "angvel", "av"}
ACCELEROMETER = {"acc", "accel", "accelerometer", "acceleration", "linacc", "beschleunigung"}
DERIVATIVE = {
    "d",
    "dot",
    "rate",
    "vel",
    "velocity",
    "speed",
    "rpm",
    "omega",
    "w",
    "spd",
    "angvel",
    "drehzahl",
    "geschwindigkeit",
}
WHEEL = {
    "wheel",
    "wheels",
    "enc",
    "encoder",
    "encoders",
    "motors",
    "joints",
    "motor",
    "mot",
    "m",
    "joint",
    "vesc",
    "whl",
    "w",
    "rad",
}
WHEEL_ANGLE = {
    "winkel",
    "radwinkel",
    "psi",
    "pos",
    "position",
    "q",
    "angle",
    "ang",
    "ticks",
    "tick",
    "count",
    "counts",
    "th",
    "theta",
    "phi",
    "tacho",
    "tachometer",
}
INPUT: dict[str, InputKind | None] = {
    "torque": "torque",
    "torques": "torque",
    "currents": "current",
    "tau": "torque",
    "trq": "torque",
    "effort": "torque",
    "moment": "torque",
    "drehmoment": "torque",
    "current": "current",
    "cur": "current",
    "curr": "current",
    "amps": "current",
    "iq": "current",
    "strom": "current",
    "motorstrom": "current",
    "i": "current",
    "duty": "duty",
    "pwm": "duty",
    "throttle": "duty",
    "servo": "duty",
    "esc": "duty",
    "dutycycle": "duty",
    "voltage": "voltage",
    "volt": "voltage",
    "volts": "voltage",
    "spannung": "voltage",
    "u": None,
    "t": None,
    "cmd": None,
    "command": None,
    "out": None,
    "output": None,
}
#: words that say nothing, and may stand in any name
EMPTY = {
    "now",
    "raw",
    "val",
    "value",
    "data",
    "meas",
    "measured",
    "actual",
    "act",
    "filtered",
    "filt",
    "body",
    "cur",
    "states",
    "field",
    "ist",
    "soll",
}
#: English for words of other languages, without their accents: Dutch, Italian, Spanish, Portuguese, French, Polish,
#: Swedish, and of German what the tables above lack. Words that mean something else in English are left out
_TRANSLATIONS = {
    "time": "tijd tijdstempel tempo tiempo temps czas tid",
    "roll": "rol rollio roulis alabeo balanceo rolagem przechylenie rollning",
    "pitch": "nick beccheggio tangage cabeceo arfagem pochylenie tippning",
    "yaw": "gier imbardata lacet guinada odchylenie girning",
    "angle": "hoek angolo angulo kat vinkel",
    "wheel": "wiel ruota roue rueda roda kolo kola hjul",
    "motor": "moteur motore silnik silnika",
    "position": "positie posizione posicion posicao pozycja weg",
    "encoder": "codeur encodeur codificador codificatore drehgeber",
    "torque": "koppel coppia couple binario vridmoment",
    "command": "stellgrosse stellgroesse stellwert befehl comando commande",
    "current": "stroom corrente corriente courant prad",
    "voltage": "spanning tensione tension tensao napiecie voltaje",
    "velocity": "snelheid velocita velocidad velocidade vitesse predkosc hastighet",
    "acceleration": "versnelling accelerazione aceleracion aceleracao przyspieszenie",
    "gyro": "gyroscoop giroscopio zyroskop",
    "tilt": "neigung helling inclinazione inclinacion inclinacao inclinaison lutning",
    "counts": "inkremente inkrement pulsen impulsi pulsos pulser impulsy",
    "battery": "accu batteria bateria",
    "error": "fout errore erreur",
    "reference": "gewenst riferimento referencia consigna consigne zadana borvarde",
}
TRANSLATED = {word: english for english, words in _TRANSLATIONS.items() for word in words.split()}
#: what words are put together of in Dutch, German and Swedish (wielhoek, motorkoppel, hjulvinkel): first and last parts
FIRST_PART = {
    **TRANSLATED,
    "motor": "motor",
    "rad": "wheel",
    "roll": "roll",
    "stamp": "pitch",
    "tipp": "pitch",
    "gir": "yaw",
}
LAST_PART = {
    **TRANSLATED,
    "winkel": "angle",
    "strom": "current",
    "spannung": "voltage",
    "moment": "torque",
    "drehzahl": "speed",
    "geschwindigkeit": "velocity",
}
#: words beside which "stamp" is the Dutch for pitch
DUTCH_ANGLES = {"rol", "rolhoek", "gier", "gierhoek"}
