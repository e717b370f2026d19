#![doc = "Raw bindings to the MuJoCo C library."]
