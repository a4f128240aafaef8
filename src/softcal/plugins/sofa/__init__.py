"""SOFA: the robot as a scene of its own files, and SOFA as an engine in the place of the statics of softcal."""
