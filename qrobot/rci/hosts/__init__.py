"""Processors of RCI on other hosts: messages and robot data over eclipse-zenoh.

`settings` are the files of both ends, `session` opens what they say and asks questions over it, `packets` are those
questions and their answers, `functions` names functions, `mail` carries messages between the lanes of both ends.
`remote_processor` is the planning program's end, `hosted_program` and `host_server` are that of the other host.
"""
