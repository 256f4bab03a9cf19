"""The friction law of one driveline, which moves an inertia."""

from ballbot.mechanics.friction_laws.classical import Classical as Classical
