/* Arms that whoever starts the program knows by name: which of them a task is connected to. */
#include "inside.h"

#define ARMS "QROBOT_RCI_ARMS" /* environment: NAME=HOST:PORT of each, commas between them */
#define PLACE_BYTES (QRW_HOST_BYTES + 16)

/* The first arm of a list. Returns the rest of the list, NULL when there is none. */
static const char *next_arm(const char *list, struct arm *arm)
{
    if (list == NULL || sscanf(list, "%64[^=,]=%64[^,]", arm->name, arm->address) != 2)
        return NULL;
    list += strcspn(list, ",");
    return list + (*list == ',');
}

/* An address in full; this machine has one name. Returns QROBOT_OK, or a status with link->error. */
static int in_full(struct qrobot_link *link, const char *address, char full[PLACE_BYTES])
{
    char host[QRW_HOST_BYTES];
    int port, status = qrw_split(link, address, host, &port);

    if (status == QROBOT_OK)
        snprintf(full, PLACE_BYTES, "%s:%d", strcmp(host, "localhost") == 0 ? "127.0.0.1" : host, port);
    return status;
}

/* The arm of a task: of those of the list the one of its name, or whose bridge the program has named, as in
 * qrobot/rci/environment.py; without a list its own. Returns QROBOT_OK, or a status with link->error. */
int rci_find_arm(const RCI_TASK *td, struct qrobot_link *link, struct arm *arm)
{
    const char *list = getenv(ARMS), *own = td->inside->address;
    struct arm each, named = {"", ""}, placed = {"", ""};
    char place[PLACE_BYTES] = "";

    snprintf(arm->name, sizeof arm->name, "%s", td->name);
    snprintf(arm->address, sizeof arm->address, "%s", own);
    if (list == NULL || *list == '\0')
        return QROBOT_OK;
    if (*own != '\0' && in_full(link, own, place) != QROBOT_OK)
        return QROBOT_INVALID;
    for (const char *rest = list; (rest = next_arm(rest, &each)) != NULL;) {
        named = strcmp(each.name, td->name) == 0 ? each : named;
        placed = strcmp(each.address, place) == 0 ? each : placed;
    }
    *arm = *named.name ? named : placed;
    if (*named.name && *placed.name && strcmp(named.name, placed.name) != 0)
        return qrw_fail(link, QROBOT_INVALID, "another arm has that name here than the one at %s; leave out the "
                        "address, or name the robot as that arm, or as none is named", place);
    if (*arm->name == '\0')
        return qrw_fail(link, QROBOT_INVALID, "no way to a robot of that name%s%s is given here; there is one to %s",
                        *place ? " or at " : "", place, list);
    return QROBOT_OK;
}
