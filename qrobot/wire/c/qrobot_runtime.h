/* The runtime folder: where the processes of an arm meet, and where no other account gets in.
 *
 * It is found by the rule of qrobot/realtime/runtime_folder.py, and a test compares the two: the first there is of
 *
 *     $QROBOT_RUNTIME_DIR
 *     /run/qrobot                 when this account owns it or is in its group `qrobot`
 *     $XDG_RUNTIME_DIR/qrobot     or else /run/user/UID/qrobot, when the folder above is this account's and in memory
 *     /dev/shm/qrobot-UID
 *
 * A folder or file of another account, or one that others may write, is not used. C99 and Linux.
 *
 * SPDX-License-Identifier: Apache-2.0
 */
#ifndef QROBOT_RUNTIME_H
#define QROBOT_RUNTIME_H

#if defined(__STRICT_ANSI__) && !defined(_POSIX_C_SOURCE)
#define _POSIX_C_SOURCE 200809L
#endif

#include <errno.h>
#include <fcntl.h>
#include <grp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/vfs.h>
#include <unistd.h>

#define QROBOT_PATH_BYTES 512
#define QROBOT_GROUP "qrobot"
#define QROBOT_GROUPS_MAX 256

/* Of linux/magic.h: tmpfs and ramfs. */
static inline int qrr_in_memory(const char *path)
{
    struct statfs system;
    return statfs(path, &system) == 0 &&
           ((unsigned long)system.f_type == 0x01021994UL || (unsigned long)system.f_type == 0x858458F6UL);
}

/* True when a file is of the group `qrobot`, and this account owns it or is in that group. */
static inline int qrr_is_of_group(const struct stat *found)
{
    gid_t groups[QROBOT_GROUPS_MAX];
    int count = getgroups(QROBOT_GROUPS_MAX, groups), mine = found->st_uid == geteuid() || found->st_gid == getegid();
    struct group *group;

    for (int i = 0; i < count && !mine; i++)
        mine = groups[i] == found->st_gid;
    group = mine ? getgrgid(found->st_gid) : NULL;
    return group != NULL && strcmp(group->gr_name, QROBOT_GROUP) == 0;
}

static inline int qrr_is_folder(const char *path, int of_group)
{
    struct stat found;
    return lstat(path, &found) == 0 && S_ISDIR(found.st_mode) && qrr_in_memory(path) &&
           (found.st_uid == geteuid() || (of_group && qrr_is_of_group(&found)));
}

/* Where the folder is, or would be made. */
static inline void qrobot_runtime_path(char path[QROBOT_PATH_BYTES])
{
    const char *chosen = getenv("QROBOT_RUNTIME_DIR"), *session = getenv("XDG_RUNTIME_DIR");
    char usual[64];

    snprintf(usual, sizeof usual, "/run/user/%lu", (unsigned long)geteuid());
    if (session == NULL || session[0] == '\0')
        session = usual;
    if (chosen != NULL && chosen[0] != '\0')
        snprintf(path, QROBOT_PATH_BYTES, "%s", chosen);
    else if (qrr_is_folder("/run/qrobot", 1))
        snprintf(path, QROBOT_PATH_BYTES, "/run/qrobot");
    else if (session[0] == '/' && qrr_is_folder(session, 0))
        snprintf(path, QROBOT_PATH_BYTES, "%s/qrobot", session);
    else
        snprintf(path, QROBOT_PATH_BYTES, "/dev/shm/qrobot-%lu", (unsigned long)geteuid());
}

/* Open a file of the folder. Returns its descriptor, or -1: with errno ENOENT when there is none, with another errno
 * when folder or file belong to somebody else, or others may write them. */
static inline int qrobot_runtime_open(const char *name, int flags)
{
    char path[QROBOT_PATH_BYTES];
    struct stat folder, file;
    int at, fd, shared;

    qrobot_runtime_path(path);
    if (path[0] != '/' || strchr(name, '/') != NULL) {
        errno = EINVAL;
        return -1;
    }
    if ((at = open(path, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC)) < 0)
        return -1;
    shared = fstat(at, &folder) == 0 && qrr_is_of_group(&folder);
    if ((folder.st_uid != geteuid() && !shared && geteuid() != 0) || (folder.st_mode & (shared ? 027 : 077)) != 0) {
        close(at);
        errno = EPERM;
        return -1;
    }
    fd = openat(at, name, flags | O_NOFOLLOW | O_CLOEXEC | O_NONBLOCK);
    close(at);
    if (fd >= 0 && (fstat(fd, &file) != 0 || !S_ISREG(file.st_mode) || file.st_uid != folder.st_uid ||
                    file.st_nlink > 1 || (file.st_mode & 037) != 0)) {
        close(fd);
        errno = EPERM;
        return -1;
    }
    return fd;
}

#endif
