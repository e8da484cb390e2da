"""Parts of `sysid.video_roll`: decoding, trackers, the camera, and the angle."""
