"""The trajectory generator in a process of its own, which shares the program's memory (Hayward & Paul 1986, section 4).

    program                                     the generator's process
    Channel, ArmSession                         TrajectoryTask, ThreadDriver, link to the bridge
      RemoteTask, RemoteDriver, RemoteLink  ->    orders, one after another, each answered       generator_host
      what the newest sample was like       <-    after each sample that answers a STATE         reports
      transforms                            <->   in shared memory, read at each sample          shared_values

Whatever holds the interpreter of the program, the generator answers the robot. Functions of the program, which it would
have to call at a sample, do not exist there, and are refused where they are given.
"""
