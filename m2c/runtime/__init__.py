"""What generated code imports: binding, ports, entry point, ECMAScript's operators and conversions."""

from m2c.language import ecmascript as ecmascript
