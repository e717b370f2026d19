#![doc = "Safe wrapper over MuJoCo."]
