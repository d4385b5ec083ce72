/* A substitute for libphidget22 in tests. It has the functions that phidget-link calls; its devices
 * are lines of a text file beside the library. Written from the documented interface, without any
 * code of Phidgets Inc.
 *
 * <library>.state   plugged N        0: no device; another number than before: the device is new
 *                   serial S         the device's serial number (12345 if there is no such line)
 *                   CLASS.PORT.TYPE V  the value of a channel, if this type of sensor is set
 *                   fail_every N     one of N readings fails
 *                   hang_ms N        duration of a reading in milliseconds
 * <library>.log     one line for each channel that is created, opened, closed or deleted
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum { OK = 0, TIMEOUT = 3, UNEXPECTED = 28, INVALID = 21, UNKNOWN_VALUE = 51, NOT_ATTACHED = 52 };

typedef struct {
	const char *class;
	int serial, hub_port, is_hub_port, port, is_open, plugged, type;
} Channel;

static __thread char last_detail[256];
static __thread int last_code;

static void beside(const char *ending, char *path, size_t room) {
	Dl_info info;
	dladdr((void *)&beside, &info);
	snprintf(path, room, "%s.%s", info.dli_fname, ending);
}

static void note(const char *what) {
	char path[4096];
	beside("log", path, sizeof path);
	FILE *log = fopen(path, "a");
	if (log == NULL) return;
	fprintf(log, "%s\n", what);
	fclose(log);
}

static int state(const char *key, double *value) {
	char path[4096], name[128];
	double number;
	int found = 0;
	beside("state", path, sizeof path);
	FILE *file = fopen(path, "r");
	if (file == NULL) return 0;
	while (!found && fscanf(file, "%127s %lf", name, &number) == 2) {
		found = strcmp(name, key) == 0;
		if (found) *value = number;
	}
	fclose(file);
	return found;
}

static int number(const char *key, int otherwise) {
	double value;
	return state(key, &value) ? (int)value : otherwise;
}

static int is_attached(Channel *channel) {
	int plugged = number("plugged", 0);
	if (!channel->is_open || plugged == 0) return 0;
	if (channel->serial != -1 && channel->serial != number("serial", 12345)) return 0;
	if (plugged != channel->plugged) channel->type = 0;
	channel->plugged = plugged;
	return 1;
}

static int value(Channel *channel, double *value) {
	static int readings;
	char key[128], place[32];
	if (!is_attached(channel)) return NOT_ATTACHED;
	usleep(1000 * number("hang_ms", 0));
	int every = number("fail_every", 0);
	if (every != 0 && __sync_add_and_fetch(&readings, 1) % every == 0) return UNEXPECTED;
	snprintf(place, sizeof place, channel->is_hub_port ? "hub%d" : "%d",
		 channel->is_hub_port ? channel->hub_port : channel->port);
	snprintf(key, sizeof key, "%s.%s.%d", channel->class, place, channel->type);
	return state(key, value) ? OK : UNKNOWN_VALUE;
}

static int create(const char *class, void **handle) {
	Channel *channel = calloc(1, sizeof *channel);
	channel->class = class;
	channel->serial = -1;
	*handle = channel;
	note("create");
	return OK;
}

int Phidget_getLibraryVersion(const char **version) {
	*version = "Phidget22 - Version 0.0 - a fake";
	return OK;
}

int Phidget_getErrorDescription(int code, const char **description) {
	*description = code == TIMEOUT ? "Timed Out" : code == NOT_ATTACHED ? "Device not Attached"
		: code == UNKNOWN_VALUE ? "Unknown or Invalid Value" : "Unexpected Error";
	return OK;
}

int Phidget_getLastError(int *code, const char **description, char *detail, size_t *room) {
	*code = last_code;
	*description = "";
	snprintf(detail, *room, "%s", last_detail);
	return OK;
}

int Phidget_setDeviceSerialNumber(void *handle, int serial) {
	((Channel *)handle)->serial = serial;
	return OK;
}

int Phidget_setHubPort(void *handle, int port) {
	((Channel *)handle)->hub_port = port;
	return OK;
}

int Phidget_setIsHubPortDevice(void *handle, int is_it) {
	((Channel *)handle)->is_hub_port = is_it;
	return OK;
}

int Phidget_setChannel(void *handle, int port) {
	((Channel *)handle)->port = port;
	return port < 8 ? OK : INVALID;
}

int Phidget_open(void *handle) {
	((Channel *)handle)->is_open = 1;
	note("open");
	return OK;
}

int Phidget_openWaitForAttachment(void *handle, uint32_t milliseconds) {
	Channel *channel = handle;
	Phidget_open(handle);
	for (uint32_t waited = 0; !is_attached(channel); waited += 5) {
		if (waited >= milliseconds) {
			channel->is_open = 0;
			note("close");
			last_code = TIMEOUT;
			strcpy(last_detail, "No Phidgets were detected at all.\nIt is a fake.");
			return TIMEOUT;
		}
		usleep(5000);
	}
	return OK;
}

int Phidget_getAttached(void *handle, int *attached) {
	*attached = is_attached(handle);
	return OK;
}

int Phidget_close(void *handle) {
	((Channel *)handle)->is_open = 0;
	note("close");
	return OK;
}

int Phidget_delete(void **handle) {
	free(*handle);
	*handle = NULL;
	note("delete");
	return OK;
}

#define CLASS(NAME, class) \
	int Phidget##NAME##_create(void **handle) { return create(class, handle); }
#define MEASURING(NAME, class, READ) \
	CLASS(NAME, class) \
	int Phidget##NAME##_##READ(void *handle, double *v) { return value(handle, v); }
#define ANALOG(NAME, class) \
	MEASURING(NAME, class, getSensorValue) \
	int Phidget##NAME##_getSensorType(void *handle, int *type) { \
		if (!is_attached(handle)) return NOT_ATTACHED; \
		*type = ((Channel *)handle)->type; \
		return OK; \
	} \
	int Phidget##NAME##_setSensorType(void *handle, int type) { \
		if (!is_attached(handle)) return NOT_ATTACHED; \
		((Channel *)handle)->type = type; \
		return OK; \
	}

MEASURING(TemperatureSensor, "temperature", getTemperature)
MEASURING(HumiditySensor, "humidity", getHumidity)
MEASURING(LightSensor, "light", getIlluminance)
ANALOG(VoltageRatioInput, "ratio")
ANALOG(VoltageInput, "voltage")
CLASS(DigitalInput, "digital")

int PhidgetDigitalInput_getState(void *handle, int *is_on) {
	double v = 0;
	int code = value(handle, &v);
	*is_on = v != 0;
	return code;
}
